"""Former name of `smpl.analysis.profiles`."""

from smpl.support.former import moved

moved(__name__, "smpl.analysis.profiles")
