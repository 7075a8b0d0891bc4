"""Thresholds: how many steps resolve a contact, which errors count as none; each with the reason
for its value.

Steps are time steps in one contact; "of a law's contact" means of the time that the law gives it.
"""

# Steps of a law's contact that a setting is made for.
# Steps of a contact under a plug-in's law: with fewer, the force over a step is not well defined.
STEPS_OF_A_LAW = 4.0
# With fewer steps the law's loop is lost anyway: contacts are softened from here.
STEPS_OF_A_LOOP = 10.0
# A contact softened at no cost in e can have more than twice the fewest steps.
STEPS_OF_A_SOFTENED = 24.0
# Few explicit steps gain energy: with so many, e gains 0.001.
STEPS_OF_A_SOFTENED_EXPLICIT = 60.0
# Steps of a linear spring and damper, so that a coarse step still samples its contact.
STEPS_OF_A_SPRING = 20.0
# A spring found closed between two steps scatters e by (π/steps)²/8: here below 0.001.
STEPS_OF_A_FITTED_SPRING = 36.0
# A spring whose damper is stepped explicitly.
STEPS_OF_AN_EXPLICIT_SPRING = 40.0
# Steps of travel at the highest speed: with fewer, e varies with the phase.
STEPS_OF_A_WIDE_SPRING = 1500.0
# Most steps of a contact: a hundred launches with more take hours.
STEPS_MOST = 1e6

# Steps of a measured contact.
# From here on there is a loop to draw.
STEPS_TO_SHOW = 8
# Up to here the phase of the touch decides about e.
STEPS_BY_CHANCE = 12
# From here on a loop can be compared with the law's.
STEPS_TO_COMPARE = 20
# From here on the ends of a loop show how its force starts and stops.
STEPS_AT_ITS_ENDS = 100
# From here on the phase of the touch is worth a part in a thousand of e.
STEPS_WITHOUT_CHANCE = 500

# How near is the same.
# Share of the impact speed, lost to or gained from others than the contact, that is reported.
NOTABLE_SHARE = 0.005
# A setting follows the law if its error is at most this share of the best constant's.
FOLLOWS = 0.1
# 95 % of a normal distribution lie within so many standard deviations of the mean.
SIGMAS_95 = 1.959964

# Round-off: less than this is nothing.
# Units in the last place of what a step adds up from the engine's own few terms.
ROUND_OFF_STEP = 16
# The same where a model's solver stands between.
ROUND_OFF_SOLVED = 64
# Round-off of a sum over all steps of a contact, relative.
ROUND_OFF_SUM = 1e-9
# Scores this near, as a share of the best constant's error, are one.
ROUND_OFF_SCORE = 1e-6
