"""Former name of `smpl.analysis.adjoint`."""

from smpl.support.former import moved

moved(__name__, "smpl.analysis.adjoint")
