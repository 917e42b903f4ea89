"""`python -m smpl` is the command `smpl`."""

from smpl.commands.main import main

raise SystemExit(main())
