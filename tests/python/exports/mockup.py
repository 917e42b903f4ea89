"""FMUs of models in the hands of FMPy."""

import shutil

import numpy as np
import pytest

import smpl

fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed")
if shutil.which("cc") is None:
    pytest.skip("there is no C compiler", allow_module_level=True)

from fmpy.fmi3 import FMU3Model, FMU3Slave  # noqa: E402

_made: dict = {}


def make(folder, name, arguments=None):
    """The FMU of a model, made once: model, path, description."""
    key = (str(name), repr(arguments))
    if key not in _made:
        model = smpl.compile(name, **(arguments or {}))
        path = smpl.export.fmu(model, folder / f"{len(_made)}.fmu")
        _made[key] = (model, path, fmpy.read_model_description(str(path)), fmpy.extract(str(path)))
    return _made[key]


class Instance:
    """An instance with its variables by name."""

    def __init__(self, description, folder, kind="model exchange"):
        self.description = description
        self.by_name = {v.name: v for v in description.modelVariables}
        exchange = kind == "model exchange"
        interface = description.modelExchange if exchange else description.coSimulation
        self.messages = []
        self.fmu = (FMU3Model if exchange else FMU3Slave)(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=interface.modelIdentifier,
            instanceName="tested",
        )
        self.fmu.instantiate(loggingOn=True)

    def reference(self, name):
        return self.by_name[name].valueReference

    def length(self, name):
        return int(np.prod([int(d.start) for d in self.by_name[name].dimensions], dtype=int))

    def get(self, name):
        return np.array(self.fmu.getFloat64([self.reference(name)], nValues=self.length(name)))

    def set(self, name, values):
        self.fmu.setFloat64([self.reference(name)], [float(x) for x in np.ravel(values)])

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
