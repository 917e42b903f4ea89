"""Former name of `smpl.analysis.fitting`."""

from smpl.support.former import moved

moved(__name__, "smpl.analysis.fitting")
