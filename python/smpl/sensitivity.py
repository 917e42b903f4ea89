"""Former name of `smpl.analysis.sensitivity`."""

from smpl.support.former import moved

moved(__name__, "smpl.analysis.sensitivity")
