"""L-BFGS: SciPy's L-BFGS-B without bounds, on knitlab's compiled energy and gradient."""

import numpy as np
from scipy.optimize import minimize

from benchmarks.solver.problem import Free, GivenUp, Problem, Search, Unknowns

NO_LIMIT = 10**9
LINE_SEARCH = 50


def lbfgs(memory: float) -> Search:
    """L-BFGS that remembers so many steps.

    Where its line search fails, in the round-off of the energy, it begins again from there.
    """

    def search(problem: Problem, start: Unknowns, free: Free) -> Unknowns:
        configuration = start.copy()

        def energy_and_gradient(unknowns: np.ndarray) -> tuple[float, np.ndarray]:
            configuration[free] = unknowns
            evaluation = problem.evaluate(configuration)
            gradient = np.asarray(evaluation.gradient)[free]
            return float(evaluation.energy.total), gradient

        unknowns = start[free]
        while True:
            found = minimize(
                energy_and_gradient,
                unknowns,
                jac=True,
                method="L-BFGS-B",
                options={
                    "maxcor": round(memory),
                    "maxls": LINE_SEARCH,
                    "ftol": 0.0,
                    "gtol": problem.tolerance,
                    "maxiter": NO_LIMIT,
                    "maxfun": NO_LIMIT,
                },
            )
            if np.abs(found.jac).max() <= problem.tolerance:
                configuration[free] = found.x
                return configuration
            if not found.nit:
                raise GivenUp(f"the line search of L-BFGS failed ({found.message})")
            unknowns = found.x

    return search
