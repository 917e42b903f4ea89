"""Former place of the console script, which environments import that were installed earlier."""

from smpl.commands.main import main

__all__ = ["main"]
