"""The columns, codes and enums of the protocol. Printed by proto/print_contract.py from proto/shearbus/v1/*.proto and
proto/wire/columns.inc, and the units of files of units.inc there."""
import enum


class Code(enum.IntEnum):
    """Status codes of the protocol. The codes from 500 on exist on the client's side only."""

    OK = 1
    BAD_FRAMING = 100
    MALFORMED = 101
    VERSION = 102
    LIMIT = 103
    CHECKSUM = 104
    SHAPE = 105
    UNSUPPORTED = 106
    UNKNOWN_SESSION = 200
    STALE_SEQUENCE = 201
    SEQUENCE_GAP = 202
    SEQUENCE_REUSED = 203
    EPOCH = 204
    NOTHING_TO_COMMIT = 205
    RESUME_REFUSED = 206
    SUPERSEDED = 207
    UNKNOWN_MARK = 208
    TRIAL_STANDS = 209
    UNKNOWN_TRANSFER = 210
    NOT_PERMITTED = 220
    INVALID_SCENE = 300
    INVALID_VALUE = 301
    UNKNOWN_NODE = 302
    DUPLICATE_NODE = 303
    NODE_OWNED = 304
    OTHER_SCENE = 305
    STEP_FAILED = 306
    SHUTTING_DOWN = 400
    INTERNAL = 401
    NO_SPACE = 402
    DRAINING = 403
    CHECKPOINT_FAILED = 404
    RECOVERING = 405
    UNREACHABLE = 500
    UNKNOWN_OUTCOME = 501
    UNEXPECTED_REPLY = 502
    AUTH = 503
    NOT_CLOSED = 504
    NO_MEMORY = 510
    LIBRARY_FAULT = 511
    IN_USE = 512
    OTHER_PROCESS = 513
    NO_LIBRARY = 514


class Regime:
    """Values of the column `regime`: what held the stress in the step."""

    OPEN = 0  # no contact: P <= 0
    STICK = 1  # no slip; the layer is elastic
    COULOMB = 2  # slip at the friction limit mu P
    TRESCA = 3  # slip, or flow of the layer, at the yield stress
    MELTING = 4  # as TRESCA, with the interface temperature T0 at or above 0.99 T_melt; or a melt film carries the stress


class Outcome:
    """Bits of the column `outcome`; 0 is success without qualification."""

    SUBSTEPPED = 1
    MULTIPLE_ROOTS = 2  # several answers satisfied the step; the node continued its previous regime
    OUTSIDE_DOMAIN = 4  # the layer does not carry the slip that the host imposes
    SUDDEN = 8  # stress or slip changed so much that shorter steps may give another jump
    OVER_BUDGET = 16  # with OUTCOME_FAILED: the step needed more work than work_budget of the scene
    ASLEEP = 32  # the node was at rest and not solved (layer.sleep); this is no warning
    FIRST_ORDER = 64  # a second-order step left its domain: solved by backward Euler instead
    FAILED = 128  # the node has no answer and keeps its old state
    FALLBACK = 160  # FAILED with ASLEEP: the host's own law answered (shearbus_set_fallback)


# name without shearbus_, types of result and arguments, of the functions of shearbus.h
FUNCTIONS = (
    ("fault_text", "Text", ""),
    ("code_name", "Text", "Whole"),
    ("field_name", "Text", "Word"),
    ("field_number", "Word", "Address"),
    ("open", "Whole", "Address Address Size Address Address Address"),
    ("open_nodes", "Whole", "Address Address Address Address"),
    ("close", "Whole", "Address Address"),
    ("end", "Whole", "Address Address Address"),
    ("leave", "", "Address"),
    ("ticket", "Whole", "Address Address Address"),
    ("resume", "Whole", "Address Address Address Address"),
    ("resume_nodes", "Whole", "Address Address Address Address Address"),
    ("resumed_nodes", "Whole", "Address Address Address"),
    ("set_reply_deadline", "Whole", "Address Double Address"),
    ("step", "Whole", "Address Address Address Address"),
    ("set_fallback", "Whole", "Address Address Address Address"),
    ("count_fallbacks", "Whole", "Address Address Address"),
    ("start", "Whole", "Address Address Address"),
    ("finish", "Whole", "Address Address Address"),
    ("commit", "Whole", "Address Address"),
    ("rollback", "Whole", "Address Address"),
    ("mark", "Whole", "Address Address Address"),
    ("rollback_to", "Whole", "Address Address Address"),
    ("profiles", "Whole", "Address Size Address Address Address Size Address Address"),
    ("register", "Whole", "Address Size Address Address Address"),
    ("register_nodes", "Whole", "Address Address Address"),
    ("retire", "Whole", "Address Size Address Address"),
    ("offer", "Whole", "Address Size Address Address Address"),
    ("accept", "Whole", "Address Address Address"),
    ("offers", "Size", "Address Size Address"),
    ("node_count", "Size", "Address"),
    ("node_ids", "Address", "Address"),
    ("effective_scene", "Text", "Address"),
    ("warnings", "Text", "Address"),
    ("inspect", "Whole", "Address Address Address"),
    ("text", "Text", "Address Whole"),
    ("columns", "Size", "Address Whole Size Address"),
    ("connect", "Whole", "Address Address Address"),
    ("disconnect", "", "Address"),
    ("ask", "Whole", "Address Address Address Address"),
    ("make_keys", "Whole", "Address Address Address"),
    ("version", "Text", ""),
)

STRATEGY = {1: "velocity_driven", 2: "force_driven"}
FAR_FIELD_FORM = ("stress_soft", "stress_hard", "mass_soft", "mass_hard")
# number, name on the wire, quantity, unit, element, kind, tangential, short name
COLUMNS = (
    (1, "node_id", "node_id", "", "Uint64", "Node", False, ""),
    (2, "initial_temperature_k", "initial_temperature", "K", "Float64", "Node", False, ""),
    (3, "pair", "pair", "", "Uint64", "Node", False, ""),
    (4, "parameter", "parameter", "", "Float64", "Node", False, ""),
    (10, "velocity_jump_m_per_s", "velocity_jump", "m/s", "Float64", "Input", True, "jump"),
    (11, "pressure_pa", "pressure", "Pa", "Float64", "Input", False, ""),
    (12, "stress_soft_pa", "stress_soft", "Pa", "Float64", "Input", True, ""),
    (13, "stress_hard_pa", "stress_hard", "Pa", "Float64", "Input", True, ""),
    (14, "mass_soft_kg_per_m2", "mass_soft", "kg/m2", "Float64", "Input", False, ""),
    (15, "mass_hard_kg_per_m2", "mass_hard", "kg/m2", "Float64", "Input", False, ""),
    (16, "soft_shear_rate_per_s", "soft_shear_rate", "1/s", "Float64", "Input", False, ""),
    (17, "soft_plastic_strain_rate_per_s", "soft_plastic_strain_rate", "1/s", "Float64", "Input", True, ""),
    (18, "stick_stress_pa", "stick_stress", "Pa", "Float64", "Stick", True, ""),
    (19, "impedance_pa_s_per_m", "impedance", "Pa s/m", "Float64", "Stick", False, ""),
    (30, "shear_stress_pa", "shear_stress", "Pa", "Float64", "Output", True, "stress"),
    (31, "sliding_velocity_m_per_s", "sliding_velocity", "m/s", "Float64", "Output", True, "slip"),
    (32, "interface_temperature_k", "interface_temperature", "K", "Float64", "Output", False, "temperature"),
    (33, "velocity_jump_new_m_per_s", "velocity_jump_new", "m/s", "Float64", "Output", True, "jump_new"),
    (36, "friction_heat_j_per_m2", "friction_heat", "J/m2", "Float64", "Output", False, ""),
    (34, "regime", "regime", "", "Uint8", "Output", False, ""),
    (35, "outcome", "outcome", "", "Uint8", "Output", False, ""),
    (37, "mean_shear_stress_pa", "mean_shear_stress", "Pa", "Float64", "Output", True, ""),
    (38, "stress_per_jump_pa_s_per_m", "stress_per_jump", "Pa s/m", "Float64", "Output", False, ""),
    (39, "stress_per_pressure", "stress_per_pressure", "1", "Float64", "Output", False, ""),
    (49, "time_to_melting_s", "time_to_melting", "s", "Float64", "Output", False, ""),
    (40, "interface_work_j_per_m2", "interface_work", "J/m2", "Float64", "Ledger", False, ""),
    (41, "heat_to_soft_j_per_m2", "heat_to_soft", "J/m2", "Float64", "Ledger", False, ""),
    (42, "heat_to_hard_j_per_m2", "heat_to_hard", "J/m2", "Float64", "Ledger", False, ""),
    (43, "plastic_work_j_per_m2", "plastic_work", "J/m2", "Float64", "Ledger", False, ""),
    (44, "stored_heat_soft_j_per_m2", "stored_heat_soft", "J/m2", "Float64", "Ledger", False, ""),
    (45, "stored_heat_hard_j_per_m2", "stored_heat_hard", "J/m2", "Float64", "Ledger", False, ""),
    (46, "elastic_energy_j_per_m2", "elastic_energy", "J/m2", "Float64", "Ledger", False, ""),
    (47, "heat_residual_j_per_m2", "heat_residual", "J/m2", "Float64", "Ledger", False, ""),
    (48, "energy_residual_j_per_m2", "energy_residual", "J/m2", "Float64", "Ledger", False, ""),
    (50, "position_m", "position", "m", "Float64", "Profile", False, ""),
    (51, "width_m", "width", "m", "Float64", "Profile", False, ""),
    (52, "layer_temperature_k", "layer_temperature", "K", "Float64", "Profile", False, ""),
    (53, "layer_plastic_strain", "layer_plastic_strain", "1", "Float64", "Profile", False, ""),
    (54, "layer_flow_stress_pa", "layer_flow_stress", "Pa", "Float64", "Profile", False, ""),
    (55, "layer_shear_stress_pa", "layer_shear_stress", "Pa", "Float64", "Profile", True, ""),
    (60, "error_estimate", "error_estimate", "1", "Float64", "Output", False, ""),
    (61, "closure_m_per_s", "closure", "m/s", "Float64", "Output", True, ""),
    (62, "film_thickness_m", "film_thickness", "m", "Float64", "Output", False, ""),
    (63, "mean_far_stress_pa", "mean_far_stress", "Pa", "Float64", "Output", False, ""),
    (70, "friction_energy_soft_j_per_m2", "friction_energy_soft", "J/m2", "Float64", "Output", False, ""),
    (71, "friction_energy_hard_j_per_m2", "friction_energy_hard", "J/m2", "Float64", "Output", False, ""),
)
# units of files: name, SI unit of the quantity, factor to it
UNITS = (
    ("s", "s", 1.0),
    ("ms", "s", 1e-3),
    ("us", "s", 1e-6),
    ("ns", "s", 1e-9),
    ("ps", "s", 1e-12),
    ("Pa", "Pa", 1.0),
    ("kPa", "Pa", 1e3),
    ("MPa", "Pa", 1e6),
    ("GPa", "Pa", 1e9),
    ("bar", "Pa", 1e5),
    ("kbar", "Pa", 1e8),
    ("Mbar", "Pa", 1e11),
    ("m/s", "m/s", 1.0),
    ("mm/s", "m/s", 1e-3),
    ("km/s", "m/s", 1e3),
    ("mm/us", "m/s", 1e3),
    ("cm/us", "m/s", 1e4),
    ("kg/m2", "kg/m2", 1.0),
    ("g/cm2", "kg/m2", 10.0),
    ("K", "K", 1.0),
    ("1/s", "1/s", 1.0),
    ("1/ms", "1/s", 1e3),
    ("1/us", "1/s", 1e6),
    ("1/ns", "1/s", 1e9),
    ("Pa s/m", "Pa s/m", 1.0),
    ("MPa s/m", "Pa s/m", 1e6),
    ("J/m2", "J/m2", 1.0),
    ("m", "m", 1.0),
    ("mm", "m", 1e-3),
    ("um", "m", 1e-6),
)
UNIT_WORDS = {
    "second": "s",
    "seconds": "s",
    "sec": "s",
    "microsecond": "us",
    "microseconds": "us",
    "nanoseconds": "ns",
    "pascal": "Pa",
    "Pascal": "Pa",
    "kelvin": "K",
    "Kelvin": "K",
}
