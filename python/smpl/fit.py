"""`python -m smpl.fit MODEL --data RUN.csv --parameters k_0,U`: the same as `smpl fit`.

The function is `smpl.fit`, in the module `smpl.analysis.fitting`.
"""

from smpl.commands.fit import main

if __name__ == "__main__":
    raise SystemExit(main())
