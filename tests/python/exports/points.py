"""Models to export, and points to compare at."""

import numpy as np

import smpl

# Every model with its scenarios and variants: what `smpl.compile` is given.
MODELS = [
    ("reactor", {}),
    ("reactor", {"scenario": "legacy"}),
    ("beer", {}),
    ("beer", {"scenario": "legacy"}),
    ("pensim", {}),
    ("pensim", {"scenario": "legacy"}),
    ("atropine", {}),
    ("atropine", {"scenario": "legacy"}),
    ("atropine", {"scenario": "coupled39"}),
    ("mab", {}),
    ("mab", {"scenario": "legacy"}),
    ("mab_plant", {}),
    ("mab_plant", {"scenario": "chain_legacy"}),
]


def label(value):
    """Name of a case: that of the model, or of its scenario."""
    return value if isinstance(value, str) else value.get("scenario", "default")


def variants(name):
    """Each switch of a model turned on, and each other option of its choices, alone."""
    tree = smpl.export.json(smpl.compile(name))
    switches = [switch["name"] for switch in tree["variants"]]
    options = [(c["name"], option) for c in tree["choices"] for option in c["options"] if option != c["chosen"]]
    return [*switches, *(f"{choice}={option}" for choice, option in options)]


class Points:
    """Random points around the nominal one, with the residual of the machine code there."""

    def __init__(self, model, tree, count, seed=0):
        random = np.random.default_rng(seed)
        elements = tree["elements"]
        self.x = self.near(elements["states"], random, count)
        self.z = self.near(elements["solved"], random, count)
        self.u = self.near(elements["actions"], random, count)
        self.d = self.near(elements["discretes"], random, count)
        # Flows that are off at the start would be divided by.
        self.d[self.d <= 1e-3] = random.uniform(0.5, 1.5, int((self.d <= 1e-3).sum()))
        self.w = self.near(elements["disturbances"], random, count)
        self.y = np.concatenate([self.x, self.z])
        self.yp = random.normal(size=self.y.shape) * np.abs(self.y)
        self.t = random.uniform(0.0, 3.0 * model.step, count)

    def near(self, elements, random, count, spread=0.1):
        """Numbers about the nominal ones, kept in the bounds; shape (elements, points)."""
        numbers = (("nominal", 0.0), ("low", -np.inf), ("high", np.inf))
        nominal, low, high = (
            np.array([default if e[key] is None else e[key] for e in elements], float) for key, default in numbers
        )
        if not elements:
            return np.empty((0, count))
        values = nominal[:, None] * (1.0 + spread * random.uniform(-1.0, 1.0, (len(elements), count)))
        small = np.abs(nominal) < 1e-9
        values[small] += spread * 1e-3 * random.uniform(0.0, 1.0, (int(small.sum()), count))
        return np.clip(values, low[:, None], high[:, None])

    def set_instants(self, model, names, p):
        """Set `initial(x)` and `previous(x)` among parameters to x, as in a step from there."""
        unknowns = dict(zip(model.unknown_names, self.y, strict=True))
        for at, name in enumerate(names):
            if name.startswith(("initial(", "previous(")):
                p[at] = unknowns[name[name.index("(") + 1 : -1]]

    def machine_code(self, model):
        """Residual at each point, shape (unknowns, points)."""
        replaced = [*model.discrete_names, *model.disturbance_names]
        rows = []
        for k in range(len(self.t)):
            p = dict(zip(replaced, [*self.d[:, k], *self.w[:, k]], strict=True))
            rows.append(model.residual(self.t[k], self.y[:, k], self.yp[:, k], self.u[:, k], p))
        return np.array(rows).T


def assert_equal(found, expected, tolerance=1e-12):
    """Equal to a tolerance relative to the largest value of the row: differences of large terms may vanish."""
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape
    if expected.size == 0:
        return  # a model without unknowns
    assert np.isfinite(expected).mean() > 0.8
    both = np.isfinite(expected)
    assert np.array_equal(np.isfinite(found), both)
    largest = np.abs(np.where(both, expected, 0.0)).max(axis=1, keepdims=True)
    errors = np.abs(np.where(both, found - expected, 0.0)) / np.maximum(largest, 1e-300)
    assert errors.max(initial=0.0) <= tolerance, (
        f"row {np.unravel_index(errors.argmax(), errors.shape)}: {errors.max()}"
    )
