"""Bundle adjustment of a window of camera poses, inverse depths, odometry scale and gyro bias.

Read `problem` for the unknowns and the residuals in full, `plain` for the residuals as NumPy (the oracle), `equations`
and `solver` for the compiled solution by Levenberg-Marquardt with the points eliminated, `preintegrate` for what
odometry says between two poses, `window` for the sliding window that runs with the images.
"""

from camnet.estimation.structure.bundle.problem import BundleProblem, BundleState, Observations, build_problem
from camnet.estimation.structure.bundle.solver import adjust
from camnet.estimation.structure.bundle.window import BundleSettings, SlidingBundle

__all__ = [
    "BundleProblem",
    "BundleSettings",
    "BundleState",
    "Observations",
    "SlidingBundle",
    "adjust",
    "build_problem",
]
