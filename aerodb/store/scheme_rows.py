"""The rows of the scheme (`aerodb.store.templates`): one per contribution.

Columns: contribution; coefficients that have it (empty: all three of the group); axes; regressors; axis of the factor K1; equation in
LR-743; meaning; what DATCOM gives, by coefficient (``CL Cm: this | CD: that``, no method for others); what LR-743 4.5 found (lift, and
roll over ground).
"""

from __future__ import annotations

_NO_METHOD = "no method"

Row = tuple[str, str, str, str, str, str, str, str, str]

# fmt: off
LONGITUDINAL: tuple[Row, ...] = (
    ("basic", "", "mach alpha", "", "", "(3)", "clean aeroplane in steady flight",
     "static page of the whole aeroplane, at one altitude", "(3) becomes a table over alpha and Mach number (Fig. 12)"),
    ("altitude", "", "h mach", "alpha", "", "(2)", "slope increment with altitude and Mach number",
     "static pages at the other altitudes less basic (Reynolds number only, no elasticity)", "not mentioned in 4.5"),
    ("flap", "", "delta_f mach alpha", "", "", "(2)", "increment of the flaps",
     "CL Cm: SYMFLP on the wing, D(CL), D(CM), wing-body | CD: SYMFLP on the wing, D(CD MIN) + D(CDI)", "replaced (Fig. 13)"),
    ("flap_slope", "", "delta_f mach", "alpha", "", "(2)", "change of slope with the flaps",
     "CL: SYMFLP on the wing, (CLA)D less its value without deflection", "part of the table that is replaced"),
    ("elevator", "", "mach alpha", "delta_e", "", "(4)", "elevator effectiveness",
     "CL Cm: SYMFLP on the tail, D(CL), D(CM) over delta_e, or an all-movable stabilizer | CD: SYMFLP on the tail, D(CD MIN) + D(CDI)",
     "kept"),
    ("elevator_flap", "", "alpha delta_f", "delta_e", "", "(4)", "elevator effectiveness, increment with flaps",
     _NO_METHOD, "kept (Fig. 14)"),
    ("elevator_altitude", "", "mach h", "delta_e", "", "(4)", "elevator effectiveness, increment with Mach number and altitude",
     "no method (elastic tail); Mach number is in elevator", "could not be identified: dropped"),
    ("elevator_deflection", "", "delta_e", "delta_e", "", "(4)", "elevator effectiveness, decrease at large deflection",
     "contained in elevator, which goes over delta_e", "could not be identified: dropped"),
    ("tab", "", "mach alpha", "delta_t", "", "(5)", "elevator trim tab",
     "no method (CONTAB gives hinge moments only)", "could not be identified: deleted"),
    ("qhat", "", "mach h alpha", "qhat", "x_cg", "(6)", "pitch rate",
     "CL Cm: CLQ, CMQ", "replaced by a table over alpha and flap setting (Fig. 15)"),
    ("qhat_flap", "", "mach delta_f alpha", "qhat", "x_cg", "(6)", "pitch rate, increment with flaps",
     _NO_METHOD, "could not be identified: deleted"),
    ("alphadothat", "", "mach h alpha", "alphadothat", "x_cg", "(7)", "rate of angle of attack",
     "CL Cm: CLAD, CMAD; where they are missing, the tail's part from the downwash",
     "embedded in the pitch-rate term in the normal envelope (collinear)"),
    ("alphadothat_flap", "", "mach delta_f alpha", "alphadothat", "x_cg", "(7)", "rate of angle of attack, increment with flaps",
     _NO_METHOD, "embedded in the pitch-rate term"),
    ("load_factor", "", "mach h", "dnz", "", "(8)", "load factor (elastic aeroplane)",
     "no method (rigid aeroplane)", "could not be identified: deleted"),
    ("load_factor_flap", "", "mach delta_f", "dnz", "", "(8)", "load factor, increment with flaps",
     _NO_METHOD, "could not be identified: deleted"),
    ("speedbrake", "", "alpha mach", "", "speedbrake", "(9)", "speed brake", _NO_METHOD, "kept"),
    ("speedbrake_flap", "", "alpha delta_f", "", "speedbrake", "(9)", "speed brake, increment with flaps",
     _NO_METHOD, "could not be identified: eliminated"),
    ("gear", "", "alpha delta_f", "", "gear", "(10)", "undercarriage",
     _NO_METHOD, "kept; the cause of the first mismatch of section 5"),
    ("gear_mach", "", "alpha", "mach", "gear", "(10)", "undercarriage, increment with Mach number", _NO_METHOD, "deleted"),
    ("qhat_gear", "", "alpha delta_f", "qhat", "gear", "4.5", "pitch rate, increment with the undercarriage", _NO_METHOD, "added"),
    ("ground", "", "alpha mach delta_f", "", "h_agl", "(11)", "ground effect",
     "GRNDEF, page over ground less page in free air", "k h^s fitted to each part, (13)"),
    ("ground_flap", "", "alpha mach delta_f", "", "h_agl", "(11)", "ground effect, increment with flaps",
     "GRNDEF with SYMFLP on the wing, less the page without deflection", "k h^s fitted for each flap setting, (13)"),
    ("ground_elevator", "", "alpha mach delta_f", "delta_e", "h_agl", "(11)", "ground effect on the elevator",
     "GRNDEF with SYMFLP on the tail, unless the program carries pages from deflection to deflection (both builds do)",
     "k h^s fitted, (13)"),
    ("ground_alphadothat", "", "delta_f", "alphadothat", "h_agl", "(11)", "ground effect on the rate of angle of attack",
     "no method (dynamic pages ignore GRNDEF)", "a pitch-rate part instead, (13)"),
    ("power", "", "mach alpha", "CT", "", "-", "power effects without the thrust force itself, per thrust coefficient",
     "CL Cm: JETPWR, PROPWR: powered page less unpowered, the thrust force taken off | CD: PROPWR: slipstream", ""),
)

LATERAL: tuple[Row, ...] = (
    ("basic", "", "mach alpha", "", "", "like (3)", "asymmetry as built", "nothing: the program's aeroplane is symmetric", ""),
    ("beta", "", "mach alpha", "beta", "", "like (3)", "sideslip", "CYB, CLB, CNB", ""),
    ("beta_flap", "", "alpha delta_f", "beta", "", "like (2)", "sideslip, increment with flaps", _NO_METHOD, ""),
    ("beta_mach", "", "mach h", "beta", "", "like (2)", "sideslip, increment with Mach number and altitude",
     "no method (elastic fin); Mach number is in beta", ""),
    ("phat", "", "mach alpha", "phat", "", "like (6)", "roll rate", "CLP, CYP, CNP", ""),
    ("phat_flap", "", "alpha delta_f", "phat", "", "like (6)", "roll rate, increment with flaps", _NO_METHOD, ""),
    ("rhat", "", "mach alpha", "rhat", "", "like (6)", "yaw rate", "Cl Cn: CLR, CNR", ""),
    ("rhat_flap", "", "alpha delta_f", "rhat", "", "like (6)", "yaw rate, increment with flaps", _NO_METHOD, ""),
    ("aileron", "", "mach alpha", "delta_a", "", "like (4)", "aileron effectiveness",
     "Cl Cn: ASYFLP, STYPE 4: (CL)ROLL, CN over delta_a, wing-body", ""),
    ("aileron_flap", "", "alpha delta_f", "delta_a", "", "like (4)", "aileron effectiveness, increment with flaps", _NO_METHOD, ""),
    ("rudder", "", "mach alpha", "delta_r", "", "like (4)", "rudder effectiveness", _NO_METHOD, ""),
    ("rudder_flap", "", "alpha delta_f", "delta_r", "", "like (4)", "rudder effectiveness, increment with flaps", _NO_METHOD, ""),
    ("tab_aileron", "", "mach alpha", "delta_ta", "", "like (5)", "aileron trim tab", _NO_METHOD, ""),
    ("tab_rudder", "", "mach alpha", "delta_tr", "", "like (5)", "rudder trim tab", _NO_METHOD, ""),
    ("betadothat", "", "mach alpha", "betadothat", "", "like (7)", "rate of sideslip", _NO_METHOD, ""),
    ("speedbrake", "", "alpha mach", "beta", "speedbrake", "like (9)", "sideslip, increment with the speed brake", _NO_METHOD, ""),
    ("gear", "", "alpha delta_f", "beta", "gear", "like (10)", "sideslip, increment with the undercarriage", _NO_METHOD, ""),
    ("ground", "CY Cn", "alpha delta_f", "", "h_agl", "like (11)", "ground effect",
     "nothing: lateral columns over ground repeat those of free air", ""),
    ("ground", "Cl", "delta_f", "phi", "h_agl", "(14)", "rolling moment over ground that levels the wings; LR-743 multiplies CL too",
     "nothing: lateral columns over ground repeat those of free air", "Cl = k h^s CL phi, k -0.078, s -1.09 at 40 deg of flap (Table 2)"),
    ("spoiler", "", "mach alpha", "delta_s", "", "-", "spoilers as roll control",
     "Cl Cn: ASYFLP, STYPE 1 to 3: (CL)ROLL, CN over delta_s, wing-body", ""),
    ("differential_tail", "", "mach alpha", "delta_d", "", "-", "halves of the stabilizer deflected against each other",
     "Cl: ASYFLP, STYPE 5: (CL)ROLL over delta_d", ""),
)

HINGES: dict[str, tuple[Row, ...]] = {
    "Ch_e": (
        ("alpha", "", "mach alpha", "alpha", "", "-", "hinge moment of the elevator, angle of attack",
         "SYMFLP on the tail, (CH)A times the angle of attack of the tail", ""),
        ("delta", "", "mach delta_e", "delta_e", "", "-", "hinge moment of the elevator, deflection",
         "SYMFLP on the tail, (CH)D times the deflection", ""),
        ("tab", "", "mach", "delta_t", "", "-", "hinge moment of the elevator, trim tab", "CONTAB: the engineer's own B4 comes back", ""),
        ("tab_gearing", "", "mach alpha delta_e", "", "", "-", "hinge moment of the elevator, geared tab",
         "CONTAB: the engineer's own B2, D1 to D3 and gearing come back", ""),
    ),
    "Ch_a": (
        ("alpha", "", "mach alpha", "alpha", "", "-", "hinge moment of the aileron, angle of attack",
         "SYMFLP on the wing with the geometry of the aileron, (CH)A", ""),
        ("delta", "", "mach delta_a", "delta_a", "", "-", "hinge moment of the aileron, deflection",
         "SYMFLP on the wing with the geometry of the aileron, (CH)D times the deflection", ""),
        ("tab", "", "mach", "delta_ta", "", "-", "hinge moment of the aileron, trim tab", _NO_METHOD, ""),
    ),
    "Ch_r": (
        ("beta", "", "mach alpha", "beta", "", "-", "hinge moment of the rudder, sideslip", _NO_METHOD, ""),
        ("delta", "", "mach delta_r", "delta_r", "", "-", "hinge moment of the rudder, deflection", _NO_METHOD, ""),
        ("tab", "", "mach", "delta_tr", "", "-", "hinge moment of the rudder, trim tab", _NO_METHOD, ""),
    ),
}
# fmt: on
