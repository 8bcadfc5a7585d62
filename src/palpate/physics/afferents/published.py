"""Published constants of tactile afferents: receptor depths, densities, and fits to single fibres.

Fits and depths: H. P. Saal, B. P. Delhaye, B. C. Rayhaun, S. J. Bensmaia, PNAS 114 (2017) E5693, as in the authors'
software TouchSim; 17 fibres of macaques. Form of the model: Y. Dong et al., J. Neurophysiol. 109 (2013) 1350.
Densities: R. S. Johansson, A. B. Vallbo, J. Physiol. 286 (1979) 283; human fingertip.
"""

import numpy as np

TYPES = ("SA1", "RA1", "PC")
DEPTHS = (0.3e-3, 1.6e-3, 2.0e-3)
"""[m] of the receptors of each type, in the order of `TYPES`."""
DENSITIES = (0.7e6, 1.4e6, 0.21e6)
"""[1/m²] of each type."""
RATE = 5000.0
"""[Hz] Sampling rate for which the fits are valid."""
PROBE = 0.5e-3
"""[m] Radius of the flat probe of the experiments, and in the stress of the fits."""
ADAPTATION = ((1.7446, 0.55), (1.0, 0.0), (1.0, 0.0))
"""Of each type: time constant [s] and share [1] of its slow adaptation. SA1: the time constant is that of the slowest
current in a model of Merkel afferents of mice (G. J. Gerling et al., PLoS Comput. Biol. 14 (2018) e1006264); the share
is fitted to the decline of the rate of 21 fibres of macaques, 38 and 36 % in 12 s of steady indentation (J. Mei et al.,
J. Neurosci. 3 (1983) 2652). RA1 and PC: none."""

# Cut-off [10 Hz], weights of the input and of its first and second difference, each where positive and where negative,
# saturation (0: none), standard deviation of the noise, time constant [samples], amplitudes of the two post-spike
# currents. Six digits; the last number of each published fit, the conduction delay, is left out.
FITS = (
    np.array([
        (10.1317, 0.434648, -0.31831, 0.00580181, -0.00396896, 0, 0, 0, 0.015625, 281.207, -0.277023, -7.37607e-06),
        (10.2383, 0.241239, 0.120739, 0.0013468, -0.000657101, 0, 0, 0, 0.015625, 249.484, -0.0368195, 0),
        (8.77336, 0.988698, 1.10861, 0.00346914, 0, 0, 0, 0, 0.015625, 168.938, -0.404516, -0.00158404),
        (10.0928, 0.253408, -0.0566815, 0.00234613, -0.00186861, 0, 0, 0, 0.0159032, 408.907, -0.00714111, 0),
    ]),
    np.array([
        (10.1855, 0, 0, 0.338496, 0.254527, -11.3443, 1.80301, 279.795, 0.0449934, 20.3965, -1.88157, -0.0787964),
        (10.5215, 0, 0, 0.225598, 0.24458, 0.0722434, -0.540572, 923.25, 0.0449934, 28.4312, -2.30488, -0.053833),
        (9.03809, 0, 0, 0, 0.558704, 0.817834, 2.66722, 2.28186, 0.0449934, 17.1122, -2.80005, -0.0485098),
        (11.665, 0, 0, 0.269336, 0.00244141, 0.720285, 0.537227, 0.995605, 0.0469055, 44.8564, -1.48965, -0.0201796),
        (17.9512, 0, 0, 0.338496, 0.254527, -9.46929, 1.80301, 279.795, 0.0510023, 19.9434, -1.80344, -0.125671),
        (14.4307, 0, 0, 0, 0.658063, 3.51519, 0.475679, 1.27393, 0.0449934, 23.4725, -1.9089, -0.0739822),
        (14.2773, 0, 0, 0.261998, 0.154359, 0.12965, -2.23921, 967.623, 0.0429453, 22.8721, -1.85386, -0.0831604),
        (7.35714, 0, 0, 0.277969, 0.0761181, 1.10742, 0.404316, 79.1892, 0.0332022, 42.6962, -1.79697, -0.0497879),
        (16.1875, 0, 0, 0.319895, 0.229973, -10.1002, 1.41313, 3.01343, 0.0449934, 20.1309, -1.35032, -0.102234),
    ]),
    np.array([
        (27.5021, 0, 0, -257.797, -185.656, 1455.15, 592.889, 10.1969, 0.05, 8.96286, -11.3215, -0.586352),
        (36.9968, 0, 0, -35.3981, -22.6539, 157.58, 174.772, 4.88204, 0.05, 4.55758, -4.548, -0.920062),
        (34.4922, 0, 0, -10.0227, 0.427685, 18.5341, 27.0733, 7.58301, 0.0413182, 6.65789, -6.21539, -0.420505),
        (30.25, 0, 0, -16.0979, -49.8073, 110.511, 277.748, 5.66524, 0.05, 4.73312, -6.15054, -0.21004),
    ]),
)  # fmt: skip
"""Of each type, one row for each fibre that was fitted."""
