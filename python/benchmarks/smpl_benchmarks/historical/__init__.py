"""The algorithms of the 2022 paper that no maintained package has, in separate environments.

They exchange files with this one: data sets as arrays, policies as TorchScript. `python -m
smpl.benchmark historical offline DIR` makes the environment of MOPO and COMBO (d3rlpy 1.1.1, Python
3.9), `online` that of PG, A3C, ARS and the others as they were (Ray 2.6.3, Python 3.10).
"""
