"""The columns of the protocol, one row each. tests/contract/python_tables.py holds the rows to proto/wire/columns.inc
and to the .proto files, so a new column fails the test until it has a row here. Nothing else in the package lists
columns: which of them a step needs, and which its reply brings, is what the server answers when a session is opened."""
from typing import NamedTuple

import numpy

FLOAT64, UINT64, UINT8 = 1, 2, 3
DTYPE = {FLOAT64: numpy.dtype("<f8"), UINT64: numpy.dtype("<u8"), UINT8: numpy.dtype("u1")}


class Column(NamedTuple):
    number: int  # shearbus.v1.Field
    wire_name: str  # name in messages of the server
    quantity: str  # name in recordings
    unit: str
    element: int = FLOAT64
    tangential: bool = False  # a vector along the interface, with two components where the scene has two
    short_name: str = ""

    @property
    def name(self):
        """Name of the column as keyword of a step and as attribute of an answer."""
        return self.short_name or self.quantity


COLUMNS = (
    Column(1, "node_id", "node_id", "", UINT64),
    Column(2, "initial_temperature_k", "initial_temperature", "K"),
    # of a request
    Column(10, "velocity_jump_m_per_s", "velocity_jump", "m/s", tangential=True, short_name="jump"),
    Column(11, "pressure_pa", "pressure", "Pa"),
    Column(12, "stress_soft_pa", "stress_soft", "Pa", tangential=True),
    Column(13, "stress_hard_pa", "stress_hard", "Pa", tangential=True),
    Column(14, "mass_soft_kg_per_m2", "mass_soft", "kg/m2"),
    Column(15, "mass_hard_kg_per_m2", "mass_hard", "kg/m2"),
    Column(16, "soft_shear_rate_per_s", "soft_shear_rate", "1/s"),
    Column(17, "soft_plastic_strain_rate_per_s", "soft_plastic_strain_rate", "1/s"),
    Column(18, "stick_stress_pa", "stick_stress", "Pa", tangential=True),
    Column(19, "impedance_pa_s_per_m", "impedance", "Pa s/m"),
    # of a reply
    Column(30, "shear_stress_pa", "shear_stress", "Pa", tangential=True, short_name="stress"),
    Column(31, "sliding_velocity_m_per_s", "sliding_velocity", "m/s", tangential=True, short_name="slip"),
    Column(32, "interface_temperature_k", "interface_temperature", "K", short_name="temperature"),
    Column(33, "velocity_jump_new_m_per_s", "velocity_jump_new", "m/s", tangential=True, short_name="jump_new"),
    Column(36, "friction_heat_j_per_m2", "friction_heat", "J/m2"),
    Column(34, "regime", "regime", "", UINT8),
    Column(35, "outcome", "outcome", "", UINT8),
    # of a reply on request: the energy ledger, the error estimate and the closure
    Column(40, "interface_work_j_per_m2", "interface_work", "J/m2"),
    Column(41, "heat_to_soft_j_per_m2", "heat_to_soft", "J/m2"),
    Column(42, "heat_to_hard_j_per_m2", "heat_to_hard", "J/m2"),
    Column(43, "plastic_work_j_per_m2", "plastic_work", "J/m2"),
    Column(44, "stored_heat_soft_j_per_m2", "stored_heat_soft", "J/m2"),
    Column(45, "stored_heat_hard_j_per_m2", "stored_heat_hard", "J/m2"),
    Column(46, "elastic_energy_j_per_m2", "elastic_energy", "J/m2"),
    Column(47, "heat_residual_j_per_m2", "heat_residual", "J/m2"),
    Column(48, "energy_residual_j_per_m2", "energy_residual", "J/m2"),
    Column(60, "error_estimate", "error_estimate", "1"),
    Column(61, "closure_m_per_s", "closure", "m/s", tangential=True),
)
# The stick form of a force-driven request has the columns of the second row in place of those of the first.
FAR_FIELD_FORM = ("stress_soft", "stress_hard", "mass_soft", "mass_hard")
STICK_FORM = ("stick_stress", "impedance")
LEDGER = range(40, 49)  # numbers of the energy ledger

BY_NUMBER = {column.number: column for column in COLUMNS}
BY_NAME = {column.name: column for column in COLUMNS}
NODE_ID, INITIAL_TEMPERATURE = BY_NUMBER[1], BY_NUMBER[2]
