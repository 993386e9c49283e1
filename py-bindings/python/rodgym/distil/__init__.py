"""Students taught by a controller or policy that sees more than they do (extra ``train``)."""

from rodgym.distil.dagger import Distillation, distil
from rodgym.distil.policy import StudentPolicy
from rodgym.distil.recipe import Recipe, RecipeError, load_recipe
from rodgym.distil.student import Shape, Student

__all__ = [
    "Distillation",
    "Recipe",
    "RecipeError",
    "Shape",
    "Student",
    "StudentPolicy",
    "distil",
    "load_recipe",
]
