"""Fingertips of measured people: constants b [N/m] and m [1/m] of the law (b/m)(e^(m s) - 1) at the compression s.

Index fingers of four people, pressed three times each by 2 mm with a ball in a testing machine (repository
nbso13/bensmaia_gelsight_scripts, 2021; at most 0.1 to 0.6 N). The fit has one m for all, one b per person, and the
unknown touch point of each press (`palpate.models.fit.finger`); "median" is the mean of the middle two. The radius of
the ball was not recorded, so the spread between people and the shape count, not the absolute force.
"""

PEOPLE = {"soft": (20.3, 1255.0), "median": (23.9, 1255.0), "stiff": (37.5, 1255.0)}
