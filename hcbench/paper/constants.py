"""The case of section 3.1."""

from hcbench.laws import hertz
from hcbench.laws.force import HuntCrossley
from hcbench.laws.hertz import HertzContact
from hcbench.terms.scene import Material
from hcbench.terms.units import INCH, POUND, POUND_FORCE, PSI

MASS = POUND
# The paper prints K3 in pounds and inches; here N/m^1.5.
STIFFNESS = 3.1e7 * POUND_FORCE / INCH**1.5
# α of the paper's section 3.2, s/m; the paper has s/in.
ALPHAS = tuple(a / INCH for a in (0.002, 0.004, 0.008, 0.016))
# Impact speeds of Fig. 4, m/s.
SPEEDS = tuple(v * INCH for v in (4.0, 8.0, 12.0, 16.0))
# The paper's section 1.9 gives the modulus and Poisson's ratio.
STEEL = Material(30e6 * PSI, 0.30)
# Radii of the ball and of the hollow surface, m.
RADIUS_1 = 1.0 * INCH
RADIUS_2 = -2.0 * INCH


def pair() -> HertzContact:
    """The two steel surfaces of section 3.1, from their radii and elastic constants."""
    return hertz.spheres(RADIUS_1, RADIUS_2, STEEL, STEEL)


def law(alpha: float) -> HuntCrossley:
    """Eq. (16) with the printed K3; α in s/m."""
    return HuntCrossley(STIFFNESS, alpha)
