"""Trajectories, derivatives and fits of models: `smpl.Model` and `smpl.fit` call them."""
