"""Generalised Voigt chain: spring-damper elements in series, by backward Euler in closed form.

One beam is h elements in series. Element j has length L_j, modulus E_j [Pa] and viscosity c_j [Pa s]:

    sigma = E_j e_j + c_j de_j/dt,        e = sum_j phi_j e_j,        phi_j = L_j / L

Compression is positive. A step of length T from the strains e_j to the imposed strain e has the answer

    b_j = E_j + c_j/T,   sigma = (e - sum_j phi_j (c_j/T) e_j / b_j) / sum_j phi_j / b_j,
    e_j <- ((c_j/T) e_j + sigma) / b_j

which is unconditionally stable, first order in T, and holds for c_j = 0 and for any T > 0.

V. A. Ho, S. Hirai, "Beam bundle model of human fingertip", eq. 2-5; there phi_j = 1, which holds for strains counted on
equal lengths only.
"""

from palpate.physics.kernel import kernel

STRAIN_LIMIT = 0.9
"""Largest compressive strain of an element [1]; the linear law has no meaning beyond, and at 1 the length is gone."""


@kernel
def chain_strain_step(strains, moduli, viscosities, shares, strain, dt):
    """Step one chain to an imposed strain; `strains` is changed in place. Stress [Pa], >= 0: a plate pushes only.

    A chain that would pull lets go and recovers freely (stress 0). An element that would pass STRAIN_LIMIT is held
    there, and the others take the rest. Elements of share 0 are absent.

    strains     [1]    (h)  of the elements, compression positive
    moduli      [Pa]   (h)  viscosities [Pa s] (h)   shares [1] (h)  L_j / L, sum 1
    strain      [1]    ()   imposed on the whole chain
    dt          [s]    ()   > 0
    """
    h = strains.shape[0]
    held = 0
    # implicit Euler with one stress for the whole chain; then again with the elements that passed the limit held there
    for _ in range(h + 1):
        rest = strain
        compliance = 0.0
        for j in range(h):
            if shares[j] == 0.0:
                continue
            if held >> j & 1:
                rest -= shares[j] * STRAIN_LIMIT
            else:
                rate = viscosities[j] / dt
                compliance += shares[j] / (moduli[j] + rate)
                rest -= shares[j] * rate * strains[j] / (moduli[j] + rate)
        if compliance == 0.0:
            break
        stress = max(rest, 0.0) / compliance
        passed = 0
        for j in range(h):
            if shares[j] > 0.0 and not held >> j & 1:
                rate = viscosities[j] / dt
                if (rate * strains[j] + stress) / (moduli[j] + rate) > STRAIN_LIMIT:
                    passed |= 1 << j
        if passed == 0:
            for j in range(h):
                rate = viscosities[j] / dt
                if held >> j & 1:
                    strains[j] = STRAIN_LIMIT
                elif shares[j] > 0.0:
                    strains[j] = (rate * strains[j] + stress) / (moduli[j] + rate)
            return stress
        held |= passed
    # all are at the limit: the stress that takes them there
    stress = 0.0
    for j in range(h):
        if shares[j] > 0.0:
            stress = max(stress, moduli[j] * STRAIN_LIMIT + viscosities[j] / dt * (STRAIN_LIMIT - strains[j]))
            strains[j] = STRAIN_LIMIT
    return stress


@kernel
def chain_stress_step(strains, moduli, viscosities, shares, stress, dt):
    """Step one chain under an imposed stress >= 0; `strains` is changed in place. Strain [1] of the whole chain.

    No element passes STRAIN_LIMIT. Arguments as `chain_strain_step`, `stress` [Pa].
    """
    total = 0.0
    for j in range(strains.shape[0]):
        if shares[j] > 0.0:
            rate = viscosities[j] / dt
            strains[j] = min((rate * strains[j] + stress) / (moduli[j] + rate), STRAIN_LIMIT)
            total += shares[j] * strains[j]
    return total


@kernel
def chain_compliance(moduli, viscosities, shares, dt):
    """d strain / d stress [1/Pa] of the next step of length dt > 0 [s], no element at its limit."""
    total = 0.0
    for j in range(moduli.shape[0]):
        if shares[j] > 0.0:
            total += shares[j] / (moduli[j] + viscosities[j] / dt)
    return total
