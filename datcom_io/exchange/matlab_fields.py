"""Table of the structure that MATLAB's ``datcomimport`` returns for Digital DATCOM.

Each field has a leaf and a variable of our tree, axes and a unit.  Names and order of indices are
those that the reference page of ``datcomimport`` documents for the 1976 version.  Numbers are as
printed: in the units of card DIM (field ``dim``), slopes per degree or per radian (field
``deriv``), angles in degrees.
"""

from __future__ import annotations

from typing import NamedTuple

from datcom_io.arrays.conditions import si_factor
from flightmech.units import parse_unit

MISSING = 99999.0
"""Number in a place without a page of the listing."""

# Indices of the arrays in the order of MATLAB.
STATIC = ("alpha", "mach", "alt", "build", "grndht", "delta")
DYNAMIC = ("alpha", "mach", "alt", "build")
DELTA = ("delta", "mach", "alt")
ALPHA_DELTA = ("alpha", "delta", "mach", "alt")
ALPHA = ("alpha", "mach", "alt")
SINGLE = ("mach", "alt")
INDEX = ("index", "mach", "alt")
JET = ("mach", "alt", "time")
HYPERSONIC = ("alpha", "delta", "mach")

BUILD = (
    frozenset(("body",)),
    frozenset(("wing",)),
    frozenset(("horizontal",)),
    frozenset(("vertical",)),
    frozenset(("body", "wing")),
    frozenset(("body", "horizontal")),
    frozenset(("body", "vertical")),
    frozenset(("body", "wing", "horizontal")),
    frozenset(("body", "wing", "vertical")),
    frozenset(("body", "wing", "horizontal", "vertical")),
)
"""Configurations along the index ``build`` when it is 10, in the order of the program."""

DELTA_DIMENSIONS = {
    "symflp": "delta",
    "tabs": "delta",
    "hypersonic": "delta",
    "asyflp": "delta_pair",
    "spoiler": "deflection",
}
"""Dimension of our leaves along the index ``delta``.

In ``static`` and ``downwash`` it is the dimension of the device.
"""
INDEX_DIMENSIONS = {
    "clalpmach": "node",
    "clalp": "node",
    "cd0mach": "drag_node",
    "cd0": "drag_node",
}
"""Dimension of our leaf ``fairing`` along the first index of a field.

The key is the name of the field without its surface.
"""


class Field(NamedTuple):
    """One array of the structure.

    ``axes`` are its indices; ``units`` those of `PrintedColumn`; ``labels`` dimension and label to
    select in our leaf; ``constant`` flags a column whose first row may hold for all rows;
    ``styles`` the values of STYPE for which the field means this variable, none for all;
    ``coordinate`` one that our leaf holds as a coordinate.
    """

    name: str
    leaf: str
    quantity: str
    axes: tuple[str, ...]
    units: str = "1"
    labels: tuple[tuple[str, str], ...] = ()
    constant: bool = False
    styles: tuple[int, ...] = ()
    coordinate: bool = False


class Units(NamedTuple):
    """Units of the numbers of a case.

    They depend on cards DIM and DERIV, and on the pressure of a jet page, ``psf`` or ``psi``.
    """

    dim: str
    deriv: str
    jet_pressure: str = "psf"

    def factor(self, units: str) -> float:
        """Return the factor from a number of the structure to SI."""
        if units in ("length", "area"):
            return si_factor(units, self.dim)
        if units == "1/angle":
            units = "1"
            if self.deriv == "DEG":
                units = "1/deg"
        if units == "pressure":
            units = self.jet_pressure
        return parse_unit(units)[1]


def _fields(
    leaf: str,
    axes: tuple[str, ...],
    text: str,
    labels: tuple[tuple[str, str], ...] = (),
    styles: tuple[int, ...] = (),
    coordinate: bool = False,
) -> list[Field]:
    """Return fields given as words ``name:variable`` or ``name:variable:units``.

    An asterisk behind the name denotes a constant column.
    """
    fields = []
    for word in text.split():
        name, quantity, units = (*word.split(":"), "1")[:3]
        field = Field(
            name=name.strip("*"),
            leaf=leaf,
            quantity=quantity,
            axes=axes,
            units=units,
            labels=labels,
            constant="*" in name,
            styles=styles,
            coordinate=coordinate,
        )
        fields.append(field)
    return fields


# Static pages with the downwash table, and dynamic pages.
_CLEAN = (
    *_fields("static", STATIC, "cd:CD cl:CL cm:Cm cn:CN ca:CA xcp:xcp"),
    *_fields("static", STATIC, "cla:CL_alpha:1/angle cma:Cm_alpha:1/angle"),
    *_fields("static", STATIC, "cyb*:CY_beta:1/angle cnb*:Cn_beta:1/angle clb:Cl_beta:1/angle"),
    *_fields("downwash", STATIC, "qqinf:q_ratio eps:epsilon:deg depsdalp:epsilon_alpha"),
    *_fields("dynamic", DYNAMIC, "clq*:CL_qhat:1/angle cmq*:Cm_qhat:1/angle"),
    *_fields("dynamic", DYNAMIC, "clad*:CL_alphadothat:1/angle cmad*:Cm_alphadothat:1/angle"),
    *_fields("dynamic", DYNAMIC, "clp*:Cl_phat:1/angle cyp*:CY_phat:1/angle"),
    *_fields("dynamic", DYNAMIC, "cnp*:Cn_phat:1/angle cnr*:Cn_rhat:1/angle clr:Cl_rhat:1/angle"),
)

# Pages of symmetrical and asymmetrical devices, and of control tabs.  The fields of asymmetrical
# devices have other variables and indices for spoilers, ailerons and the differential tail.
_DEVICES = (
    *_fields("symflp", DELTA, "dcl_sym:dCL dcm_sym:dCm dclmax_sym:dCLmax dcdmin_sym:dCDmin"),
    *_fields("symflp", DELTA, "clad_sym:CL_alpha_delta:1/deg"),
    *_fields("symflp", DELTA, "cha_sym*:Ch_alpha:1/deg chd_sym:Ch_delta:1/deg"),
    *_fields("symflp", ALPHA_DELTA, "dcdi_sym:dCDi"),
    *_fields(
        "spoiler", DELTA, "xsc:xs_c hsc:hs_c ddc:dd_c dsc:ds_c", styles=(1, 2, 3), coordinate=True
    ),
    *_fields("spoiler", DELTA, "clroll:Cl cn_asy:Cn", styles=(1, 2, 3)),
    *_fields("asyflp", DELTA, "clroll:Cl", styles=(4,)),
    *_fields("asyflp", ALPHA_DELTA, "cn_asy:Cn", styles=(4,)),
    *_fields("asyflp", ALPHA_DELTA, "clroll:Cl", styles=(5,)),
    *_fields("tabs", ALPHA_DELTA, "fc_con:F_stick:lbf fhmcoeff_free:Ch_tab_free"),
    *_fields("tabs", ALPHA_DELTA, "fhmcoeff_lock:Ch_tab_locked fhmcoeff_gear:Ch_tab_gearing"),
    *_fields("tabs", ALPHA_DELTA, "ttab_def:delta_tab_trim:deg"),
)

# Trim pages with a control device and with an all-movable stabilizer.
_TRIM = (
    *_fields("trim", ALPHA, "cl_utrim:CL cd_utrim:CD cm_utrim:Cm delt_trim:delta_trim:deg"),
    *_fields("trim", ALPHA, "dcl_trim:dCL dclmax_trim:dCLmax dcdi_trim:dCDi dcdmin_trim:dCDmin"),
    *_fields("trim", ALPHA, "cha_trim*:Ch_alpha:1/deg chd_trim:Ch_delta:1/deg"),
    *_fields("trim_stabilizer", ALPHA, "cd_tailutrim:CD_tail cl_tailutrim:CL_tail"),
    *_fields("trim_stabilizer", ALPHA, "cm_tailutrim:Cm_tail hm_tailutrim:Ch_tail"),
    *_fields("trim_stabilizer", ALPHA, "aliht_tailtrim:i_tail:deg"),
    *_fields("trim_stabilizer", ALPHA, "cd_tailtrim:CD_tail_trim cl_tailtrim:CL_tail_trim"),
    *_fields("trim_stabilizer", ALPHA, "cm_tailtrim:Cm_tail_trim hm_tailtrim:Ch_tail_trim"),
    *_fields("trim_stabilizer", ALPHA, "cl_trimi:CL cd_trimi:CD"),
)

# Hypersonic and transverse-jet pages.
_SPECIAL = (
    *_fields("hypersonic", HYPERSONIC, "df_normal:dCN:1/ft df_axial:dCA:1/ft"),
    *_fields("hypersonic", HYPERSONIC, "cm_normal:dCm_CN:1/ft cm_axial:dCm_CA:1/ft"),
    *_fields("hypersonic", HYPERSONIC, "cp_normal:xcp_CN cp_axial:zcp_CA"),
    *_fields("jet", JET, "time:time blayer:boundary_layer:text", coordinate=True),
    *_fields("jet", JET, "ctrlfrc:F_control:lbf locmach:mach_local reynum:reynolds_local"),
    *_fields("jet", JET, "locpres:p_local:pressure dynpres:qbar_local:pressure"),
    *_fields("jet", JET, "ctrlcoeff:C_control corrcoeff:C_control_corrected"),
    *_fields("jet", JET, "sonicamp:amplification_sonic ampfact:amplification"),
    *_fields("jet", JET, "vacthr:F_vacuum:lbf minpres:p_jet_ratio_min"),
    *_fields("jet", JET, "minjet:p_jet_min:pressure jetpres:p_jet:pressure"),
    *_fields("jet", JET, "massflow:mass_flow:lb/s propelwt:propellant_mass:lb"),
)

# Page of the body, card PART.
_BODY = (
    *_fields("auxiliary", SINGLE, "wetarea_b:area_wetted:area xcg_b:x_moment_centre:length"),
    *_fields("auxiliary", SINGLE, "zcg_b:z_moment_centre:length basearea_b:area_base:area"),
    *_fields("auxiliary", SINGLE, "cd0_b:CD0 basedrag_b:CD_base"),
    *_fields("auxiliary", SINGLE, "fricdrag_b:CD_friction presdrag_b:CD_pressure"),
    *_fields("auxiliary", SINGLE, "lemac:x_behind_mac:length"),
)

# Letters of the surfaces, panels and configurations in the names of fields.
_PANELS = {
    "ti": "theoretical inboard",
    "ei": "exposed inboard",
    "o": "outboard",
    "tt": "total theoretical",
    "te": "total exposed",
}
_SURFACES = {"w": "wing", "ht": "horizontal tail", "vt": "vertical tail", "vf": "ventral fin"}
_FAIRING = {"w": "wing", "wb": "wing-body", "ht": "horizontal tail", "bht": "horizontal tail-body"}
LABELS = {
    "surface": tuple(_SURFACES.values()),
    "panel": tuple(_PANELS.values()),
    "configuration": tuple(_FAIRING.values()),
}
"""Labels along the dimensions that the structure has in the names of its fields.

They have the order of our leaves.
"""

# Planform properties: beginning of the name, variable, units.
_PLANFORM = (
    ("area", "area", "area"),
    ("taperratio", "taper_ratio", "1"),
    ("aspectratio", "aspect_ratio", "1"),
    ("qcsweep", "sweep_c4", "deg"),
    ("mac", "mac", "length"),
    ("qcmac", "x_c4_mac", "length"),
    ("ymac", "y_mac", "length"),
    ("cd0", "CD0", "1"),
    ("friccoeff", "Cf", "1"),
)


def _planform_fields() -> list[Field]:
    """Return the planform properties of every surface and panel."""
    fields = []
    for letter, surface in _SURFACES.items():
        for short, panel in _PANELS.items():
            labels = (("surface", surface), ("panel", panel))
            for name, quantity, units in _PLANFORM:
                field = Field(
                    f"{name}_{letter}_{short}", "planform", quantity, SINGLE, units, labels=labels
                )
                fields.append(field)
    return fields


def _interference_fields() -> list[Field]:
    """Return the interference factors of wing and horizontal tail, and the sidewash."""
    fields = []
    for letter in ("w", "ht"):
        labels = (("surface", _SURFACES[letter]),)
        text = (
            f"cla_b_{letter}:CL_alpha_body:1/deg cla_{letter}_b:CL_alpha_surface:1/deg "
            f"k_b_{letter}:K_body k_{letter}_b:K_surface xacc_b_{letter}:xac_body"
        )
        fields += _fields("interference", SINGLE, text, labels=labels)
    return [*fields, *_fields("interference", SINGLE, "sidewash:sidewash")]


# Vortices, increments of dynamic derivatives and downwash of a canard, card PART.
_INCREMENTS = (
    *_fields("vortex", ALPHA, "hiv_b_w:i_body_wing hiv_w_h:i_wing_tail hiv_b_h:i_body_tail"),
    *_fields("vortex", ALPHA, "gamma:gamma gamma2pialpvr:gamma_tail"),
    *_fields("increments", SINGLE, "clpgammacl0:Cl_phat clpgammaclp:Cl_phat_ratio_dihedral"),
    *_fields("increments", SINGLE, "cnptheta:Cn_phat_twist:1/deg"),
    *_fields("increments", SINGLE, "cypgamma:dCY_phat_dihedral cypcl:CY_phat_CL"),
    *_fields("increments", SINGLE, "clbgamma:Cl_beta_dihedral:1/deg2"),
    *_fields("increments", SINGLE, "cmothetaw:Cm0_twist_wing:1/deg"),
    *_fields("increments", SINGLE, "cmothetah:Cm0_twist_tail:1/deg"),
    *_fields("canard_downwash", ALPHA, "espeff:epsilon_effective:deg"),
    *_fields("canard_downwash", ALPHA, "despdalpeff:epsilon_alpha_effective"),
)

# Transonic data fairing: beginning of the name, variable, units, letters of the configurations.
_FAIRED = (
    ("cdlcl2", "CDL_CL2", "1", "w ht"),
    ("clbcl", "Cl_beta_CL", "1/deg", "w ht wb bht"),
    ("fmach0", "mach_break_unswept", "1", "w ht"),
    ("fmach", "mach_break", "1", "w ht"),
    ("macha", "mach_a", "1", "w ht"),
    ("claa", "CL_alpha_a", "1/deg", "w ht"),
    ("machb", "mach_b", "1", "w ht"),
    ("clab", "CL_alpha_b", "1/deg", "w ht"),
    ("clbm06", "Cl_beta_CL_mach_06", "1/deg", "w ht"),
    ("clbm14", "Cl_beta_CL_mach_14", "1/deg", "w ht wb bht"),
    ("clbclmfb", "Cl_beta_CL_break", "1/deg", "wb bht"),
    ("cnam14", "CN_alpha_mach_14", "1/deg", "wb bht"),
)


def _fairing_fields() -> list[Field]:
    """Return the transonic data fairing: single numbers, then tables over Mach number."""
    fields = []
    for name, quantity, units, letters in _FAIRED:
        for letter in letters.split():
            labels = (("configuration", _FAIRING[letter]),)
            fields.append(
                Field(f"{name}_{letter}", "fairing", quantity, SINGLE, units, labels=labels)
            )
    for letter in ("w", "ht"):
        labels = (("configuration", _FAIRING[letter]),)
        text = f"clalpmach_{letter}:CL_alpha_mach clalp_{letter}:CL_alpha:1/deg"
        fields += _fields("fairing", INDEX, text, labels=labels)
    fields += _fields("fairing", SINGLE, "dragdiv:mach_divergence")
    return [*fields, *_fields("fairing", INDEX, "cd0mach:CD0_mach cd0:CD0")]


FIELDS: tuple[Field, ...] = (
    *_CLEAN,
    *_DEVICES,
    *_TRIM,
    *_SPECIAL,
    *_BODY,
    *_planform_fields(),
    *_interference_fields(),
    *_INCREMENTS,
    *_fairing_fields(),
)
"""All fields, in the order of MATLAB."""


def select_fields(style: int) -> list[Field]:
    """Return the fields of a case by its STYPE."""
    return [field for field in FIELDS if not field.styles or style in field.styles]


def field_dimension(field: Field, axis: str, device: str) -> str:
    """Return the dimension of our leaf along an index other than Mach number and altitude."""
    if axis == "index":
        name = field.name
        if field.labels:
            name = name.rpartition("_")[0]
        return INDEX_DIMENSIONS[name]
    if axis == "delta":
        return DELTA_DIMENSIONS.get(field.leaf, device)
    return {"build": "configuration", "grndht": "ground_height"}.get(axis, axis)
