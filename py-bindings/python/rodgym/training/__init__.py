"""Training of agents by Stable-Baselines3 on the native batch (extra ``train``)."""

from rodgym.training.recipe import Recipe, has_recipe, load_recipe, zoo_policy
from rodgym.training.trainer import Training, train

__all__ = ["Recipe", "Training", "has_recipe", "load_recipe", "train", "zoo_policy"]
