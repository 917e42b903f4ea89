"""The console script `smpl`, and what the commands of the package share."""
