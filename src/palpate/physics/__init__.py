"""Formulas: arrays in, arrays out. Imports only numpy, scipy and numba, so it can be used alone in a notebook.

The public laws are `__all__`, `from palpate.physics import lugre`; each is imported on first use. Everything else in
the modules is internal and may change.
"""

from typing import Any

_LAWS = {
    "afferents.population": ("Population",),
    "afferents.probe": ("median_threshold", "tuning_threshold"),
    "bodies.beam_foundation": ("BeamFoundation", "beam_foundation"),
    "bodies.condensed_basis": ("Basis",),
    "bodies.condensed_body": ("CondensedBody", "condensed_body"),
    "bodies.large_displacement": ("large_depth", "linear_depth", "nonlinearity", "stored_energy"),
    "bodies.mass_spring": ("NodalBody", "nodal_body"),
    "bodies.sampled_body": ("SampledBasis", "SampledBody", "sampled_body"),
    "contact.area": ("AreaLaw", "hertz_depth"),
    "contact.deflection": ("surface_under_patch",),
    "contact.force_band": ("Band", "band_at"),
    "contact.force_models": ("ForceModel",),
    "contact.grip": ("grip_force", "internal_forces"),
    "contact.joint": ("joint_step",),
    "contact.layer": ("thickness_factor",),
    "contact.series": ("ElasticLaw", "elastic", "exponential", "hertz_exponential", "power", "series_step"),
    "contact.spread": ("kernel_value",),
    "contact.subsurface": ("point_stress", "strain_energy_of", "under_patch", "von_mises_of"),
    "contact.tactile": ("equivalent_strain", "growth", "isostrain_volume", "stick_radius", "tactile_flow"),
    "contact.terminal": ("Terminal", "fit_terminal", "free_recovery", "indentation", "terminal_force"),
    "device.controller": ("haptic",),
    "device.falcon": ("FALCON", "FalconGeometry", "forward_kernel", "leg"),
    "device.falcon_statics": ("force_kernel", "torque_kernel"),
    "device.passivity": ("absorbed_energy", "clamp", "dissipation", "slew"),
    "device.rendered": ("compensation", "stiffest"),
    "device.stability": ("passive_stiffness", "quantised_stiffness", "stable_stiffness"),
    "device.stick": ("HeldDevice", "resting_spring"),
    "device.wall_loop": ("WallDevice",),
    "display.pin_heights": ("heights_from_force", "heights_from_pressure", "heights_from_surface"),
    "display.pins": ("approach_target", "fit_stroke", "pin_grid"),
    "display.shape_display": ("Fingerpad", "PadContact", "deflection_under", "pad_contact", "pad_displacement"),
    "errors": ("ArgumentError", "MeshError", "PalpateError", "PalpateWarning", "RunError"),
    "fingertip.anatomy": ("Anatomy",),
    "fingertip.beam_bundle": ("Bundle", "bundle"),
    "fingertip.stick_slip": ("stick_slip",),
    "fingertip.surfaces": ("FingertipSurfaces",),
    "friction.coulomb": ("Coulomb", "coulomb"),
    "friction.elastoplastic": ("ElastoPlastic", "elastoplastic"),
    "friction.lugre": ("LuGre", "lugre", "stribeck"),
    "geometry.closest": ("ClosestPoint",),
    "geometry.kidney": ("kidney",),
    "geometry.mesh": ("Mesh", "plane"),
    "geometry.mesh_closest": ("MeshClosestPoint",),
    "geometry.nurbs": ("NurbsPatch",),
    "geometry.nurbs_fit": ("capsule", "interpolate", "plane_patch", "sphere"),
    "geometry.pseudonormal": ("signed_distance",),
    "geometry.refined.divided": ("refine_mesh",),
    "geometry.strain": ("largest_stretch",),
    "geometry.tessellate": ("tessellate",),
    "geometry.thinned": ("thin_mesh",),
    "materials.demiray": ("demiray",),
    "materials.hencky": ("hencky",),
    "materials.hyperelastic": ("Material", "MaterialError", "law", "laws", "moduli", "poisson_of", "uniaxial"),
    "materials.invariants": ("shape_invariants", "shape_stress"),
    "materials.linear": ("linear",),
    "materials.mooney_rivlin": ("mooney_rivlin",),
    "materials.neo_hooke": ("neo_hooke",),
    "materials.nodule": ("nodule_centre", "stiffness_map"),
    "materials.ogden": ("ogden",),
    "materials.prony": ("relax_response",),
    "materials.voigt": ("ViscoelasticMaterial", "chain_strain_step", "chain_stress_step"),
    "materials.yeoh": ("yeoh",),
    "texture.autoregressive": ("line_spectrum", "spectrum", "yule_walker"),
    "texture.surface": ("density", "grating", "random_surface", "third_octaves"),
}
_HOMES = {name: module for module, names in _LAWS.items() for name in names}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'palpate.physics' has no attribute {name!r}; public: {', '.join(__all__)}")
