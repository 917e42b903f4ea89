"""`python -m smpl` is the command `smpl`."""

from smpl._cli import main

raise SystemExit(main())
