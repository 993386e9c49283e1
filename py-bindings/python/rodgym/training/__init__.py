"""Training of agents by Stable-Baselines3 on the native batch (extra ``train``)."""

from rodgym.training.own_actions import OwnActions
from rodgym.training.recipe import Recipe, has_recipe, load_recipe, zoo_policy
from rodgym.training.seeds import train_seeds
from rodgym.training.staggered import Staggered
from rodgym.training.trainer import keep_unfinished, resume, train, unfinished
from rodgym.training.training import Training, load_training
from rodgym.zoo.algorithms import ALGORITHMS, algorithm_class

__all__ = [
    "ALGORITHMS",
    "OwnActions",
    "Recipe",
    "Staggered",
    "Training",
    "algorithm_class",
    "has_recipe",
    "keep_unfinished",
    "load_recipe",
    "load_training",
    "resume",
    "train",
    "train_seeds",
    "unfinished",
    "zoo_policy",
]
