"""Thresholds: how many steps resolve a contact, which errors count as none; each with the reason
for its value.

Steps are time steps in one contact; "of a law's contact" means of the time that the law gives it.
"""

# Steps of a law's contact that a setting is made for.
STEPS_OF_A_LAW = 4.0  # of a plug-in's: fewer, and the force over a step is no longer well defined
STEPS_OF_A_LOOP = 10.0  # fewer, and the law's own loop is lost anyway: contacts are softened from here
STEPS_OF_A_SOFTENED = 24.0  # softened at no cost in e, it can have more than twice the fewest
STEPS_OF_A_SOFTENED_EXPLICIT = 60.0  # few explicit steps gain energy: with so many e gains 0.001
STEPS_OF_A_SPRING = 20.0  # a linear spring and damper, so that a coarse step still samples its contact
STEPS_OF_A_FITTED_SPRING = 36.0  # found closed between two steps, it scatters e by (π/steps)²/8: below 0.001
STEPS_OF_AN_EXPLICIT_SPRING = 40.0  # as a spring, but its damper is stepped explicitly
STEPS_OF_A_WIDE_SPRING = 1500.0  # of travel at the highest speed: fewer, and e varies with the phase
STEPS_MOST = 1e6  # of a contact: a hundred launches of more take hours

# Steps of a measured contact.
STEPS_TO_SHOW = 8  # from here there is a loop to draw
STEPS_BY_CHANCE = 12  # up to here the phase of the touch decides about e
STEPS_TO_COMPARE = 20  # from here a loop can be compared with the law's
STEPS_AT_ITS_ENDS = 100  # from here the ends of a loop say how its force starts and stops
STEPS_WITHOUT_CHANCE = 500  # from here the phase of the touch is worth a part in a thousand of e

# How near is the same.
FOLLOWS = 0.1  # of the best constant's error: with no more, a setting follows the law
SIGMAS_95 = 1.959964  # standard deviations on either side of a mean that hold 95 % of a normal distribution

# Round-off: less than this is nothing.
ROUND_OFF_STEP = 16  # units in the last place of what a step adds up, from the engine's own few terms
ROUND_OFF_SOLVED = 64  # units in the last place, where a model's solver stands between
ROUND_OFF_SUM = 1e-9  # of a sum over all steps of a contact
ROUND_OFF_SCORE = 1e-6  # of the best constant's error: scores this near are one
