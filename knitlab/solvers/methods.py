"""The methods by which cases are simulated, by name; each is one class."""

from knitlab.solvers.dynamics.method import DampedDynamics
from knitlab.solvers.equilibrium.method import Equilibrium
from knitlab.solvers.method import Method

METHODS: dict[str, Method] = {method.name: method for method in (Equilibrium(), DampedDynamics())}
