"""Former name of `smpl.analysis.rollout`."""

from smpl.support.former import moved

moved(__name__, "smpl.analysis.rollout")
