"""Registration of the shipped models with Gymnasium."""

from __future__ import annotations

import gymnasium

from smpl.support.files import is_shipped

# Name of the environment -> file of the model.
ENVIRONMENTS = {
    "Reactor": "reactor",
    "Beer": "beer",
    "PenSim": "pensim",
    "Atropine": "atropine",
    "MAb": "mab",
    "MAbPlant": "mab_plant",
}

# The same for the plants in `models/gallery`.
GALLERY = {
    "TennesseeEastman": "tennessee_eastman",
    "BSM1": "bsm1",
    "FourTanks": "four_tanks",
    "VanDeVusse": "van_de_vusse",
    "WilliamsOtto": "williams_otto",
    "ColumnA": "column_a",
    "PHNeutralisation": "ph_neutralisation",
    "Evaporator": "evaporator",
    "FirstOrder": "first_order",
    "SecondOrder": "second_order",
    "CSTR": "cstr",
    "Extraction": "extraction",
    "ReactiveExtraction": "reactive_extraction",
    "ReactorSeparator": "reactor_separator",
    "RecycleCascade": "recycle_cascade",
    "Distillation": "distillation",
    "HeatExchanger": "heat_exchanger",
    "Biofilm": "biofilm",
    "Polymerisation": "polymerisation",
    "PotassiumSulfate": "potassium_sulfate",
    "Bioreactor": "bioreactor",
    "MMA": "mma",
    "Crystalliser": "crystalliser",
    "BoilerDrum": "boiler_drum",
    "GlucoseInsulin": "glucose_insulin",
    "BakersYeast": "bakers_yeast",
    "LithiumIon": "lithium_ion",
    "XyleneBed": "xylene_bed",
    "ChyllaHaase": "chylla_haase",
    "ExchangerNetwork": "exchanger_network",
}


def register_envs() -> None:
    """Register `smpl/NAME-v0` for every shipped model, unless it is registered already.

    No `max_episode_steps` is given: the environment counts its steps itself, by its scenario. Entry
    points are text and arguments plain data, so that a specification can be written as JSON.
    """
    for name, model in (ENVIRONMENTS | GALLERY).items():
        identifier = f"smpl/{name}-v0"
        if identifier in gymnasium.registry or not is_shipped(model):
            continue
        gymnasium.register(
            id=identifier,
            entry_point="smpl.envs:Env",
            vector_entry_point="smpl.vector:VectorEnv",
            kwargs={"model": model},
        )
