"""The controller that drives where it has seen floor: `control` is its step, the other files are its parts."""

from ndtorch.navigation.controllers.ranging import control as control
