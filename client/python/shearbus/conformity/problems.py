"""The problems that the mock server plays: bodies, start, pressure, the law of friction, and the exact jump. Their equations are on
the page client/examples/problems/README.md."""
import math

import numpy

PLATE = {"depth": 0.5e-3, "near": 78e-9, "least": 470e-9}  # m, with a free back
SOFTENING = {"yield": 200e6, "per_pa": 6.52e-11, "per_k": 6.16e-4, "melting": 1220.0}  # Pa, 1/Pa, 1/K, K
# What a problem has other than two half-spaces:
#   jump         (m/s) of the host at the start
#   pressures    ((from s, Pa), ...) of the host
#   coefficient  of friction
#   melting      (K) temperature at which friction is what keeps T0 there
#   softening    strength of the soft body, which limits the friction in place of `coefficient`
#   masses       (kg/m2) of bodies without strength
#   depth        (m) of the soft body, whose back is free
#   rest         (from, until s) in which nothing slides
#   least        (s) that a run has to last
#   near         (s) from a front, which a host smears: the jump is not checked there
CASES = {
    "two_half_spaces": {},
    "finite_plate": PLATE,
    "softening_friction": {"pressures": ((0.0, 11.2e9),), "softening": SOFTENING, "least": 60e-9},
    "stick_slip_brake": {**PLATE, "jump": 30.0, "pressures": ((0.0, 1e9), (1.1e-6, 0.1e9)), "near": 40e-9, "rest": (720e-9, 1.09e-6),
                         "least": 1.16e-6},
    "flash_to_melting": {"jump": 400.0, "coefficient": 0.1, "melting": 1220.0, "least": 400e-9},
    "opening_and_closing": {"pressures": ((0.0, 1e9), (100e-9, -0.5e9), (200e-9, 1e9)), "least": 260e-9},
    "turned_line": {},
    "without_strength": {"masses": (0.02703, 0.079), "rest": (45e-9, math.inf), "least": 55e-9},
}


class Problem:
    """Two bodies under friction: aluminium (soft, z > 0) on steel (hard, z < 0). A wave R reaches the interface from the soft body:
    V_soft = (R - s) / Z_soft, V_hard = s / Z_hard. It is Z_soft V0 in a half-space; in a plate with a free back it falls by twice the
    stress at every return. s is the friction, or the less that stops the jump."""

    NAMES = tuple(CASES)
    density, modulus = (2703.0, 7900.0), (27.6e9, 77e9)
    effusivity = (117.0 / math.sqrt(48.9e-6), 16.1 / math.sqrt(4.076e-6))  # sqrt(k rho c), W sqrt(s)/(m2 K)
    to_soft = effusivity[0] / sum(effusivity)  # of the heat
    start = 300.0  # K

    def __init__(self, name):
        case = {"jump": 100.0, "pressures": ((0.0, 1e9),), "coefficient": 0.05, **CASES[name]}
        self.name, self.jump, self.pressures, self.coefficient = name, case["jump"], case["pressures"], case["coefficient"]
        self.softening, self.melting = case.get("softening"), case.get("melting", math.inf)
        self.factor = 1.0  # of the friction
        self.rest, self.masses, self.finite = case.get("rest"), case.get("masses"), "depth" in case
        self.impedance = [math.sqrt(d * m) for d, m in zip(self.density, self.modulus)]
        self.round_trip = 2 * case.get("depth", math.inf) * math.sqrt(self.density[0] / self.modulus[0])
        self.long_enough, self.near = case.get("least", 0.0), case.get("near", 30e-9)
        self.friction = self.limit(self.pressure(0.0), self.start)  # Pa, at the start

    def pressure(self, time):
        return [pressure for since, pressure in self.pressures if since <= time or since == 0][-1]

    def limit(self, pressure, temperature):
        """Returns the largest friction stress at a pressure (Pa) and temperature of the interface (K)."""
        law = self.softening
        melting = law["melting"] if law else self.melting
        if pressure <= 0 or temperature >= melting:
            return 0.0
        if not law:
            return self.factor * self.coefficient * pressure
        return (law["yield"] / math.sqrt(3) * (1 + law["per_pa"] * pressure - law["per_k"] * (temperature - 300)) *
                math.exp(-0.001 * temperature / (melting - temperature)))

    def wave(self, time):
        """Returns the wave that reaches the interface and the stress there at a time, Pa; friction is constant."""
        wave = self.impedance[0] * self.jump
        if self.finite and time >= self.round_trip:
            before, stress = self.wave(time - self.round_trip)
            wave = before - 2 * stress
        limit = self.limit(self.pressure(time), self.start)
        return wave, max(-limit, min(limit, wave / (1 + self.impedance[0] / self.impedance[1])))

    def exact_jump(self, time, stress):
        """Returns the jump (m/s) at a time (s), or None near a front. Between half-spaces it follows the stress (Pa) of the moment."""
        fronts = [since for since, _ in self.pressures[1:]]
        if self.finite:
            fronts = [front + n * self.round_trip for front in (0.0, *fronts) for n in range(20) if front + n > 0]
        if any(abs(time - front) < self.near for front in fronts):
            return None
        if self.masses:
            return max(0.0, self.jump - self.friction * time * sum(1 / mass for mass in self.masses))
        if not self.finite:
            return self.jump - stress * sum(1 / z for z in self.impedance)
        wave, stress = self.wave(time)
        return (wave - stress) / self.impedance[0] - stress / self.impedance[1]

    def changed(self, time):
        """Returns what the friction has taken from the jump (m/s) at a time (s), fronts apart."""
        if self.masses:
            return self.jump - self.exact_jump(time, 0.0)
        returns = time // self.round_trip if self.finite else 0
        return min(self.jump, self.friction * (sum(1 / z for z in self.impedance) + returns * 2 / self.impedance[0]))

    def stress(self, sticking, heat_of, temperature_of, pressure):
        """Returns the stress (Pa) of a step and T0 (K) at its end. sticking: the stress that stops the jump; heat_of(s): the power (W/m2)
        that the stress s releases; temperature_of(q): T0 at the end of a step of the power q. s is at most the limit at this T0."""
        low, high = 0.0, min(sticking, self.limit(pressure, temperature_of(0.0)))
        if self.limit(pressure, temperature_of(heat_of(high))) >= high:
            return high, temperature_of(heat_of(high))
        for _ in range(60):  # friction falls with T0, which rises with s
            middle = (low + high) / 2
            above = self.limit(pressure, temperature_of(heat_of(middle))) < middle
            low, high = (low, middle) if above else (middle, high)
        return low, temperature_of(heat_of(low))


class Heat:
    """T0 of nodes between two half-spaces, from the power of each step: T_start + 1/(E sqrt(pi)) times the integral of q / sqrt(t - x)."""

    def __init__(self, nodes):
        self.row = {node: row for row, node in enumerate(nodes)}
        self.scale = 2 / (sum(Problem.effusivity) * math.sqrt(math.pi))
        self.steps = 0  # the arrays have room for more
        self.ends, self.powers = numpy.zeros(2), numpy.zeros((1, len(self.row)))

    def begin(self, dt):
        """Returns {node: T0 at the end of a step of length dt without power}, and what a power of 1 W/m2 in it adds."""
        ends = self.ends[:self.steps + 1]
        roots = numpy.sqrt(ends[-1] + dt - ends)
        known = Problem.start + self.scale * ((roots[:-1] - roots[1:]) @ self.powers[:self.steps])
        return {node: known[row] for node, row in self.row.items()}, self.scale * math.sqrt(dt)

    def accept(self, dt, powers):
        """Ends a step with {node: its power}; the nodes that it does not name had none."""
        if self.steps == len(self.powers):
            self.powers = numpy.concatenate((self.powers, numpy.zeros_like(self.powers)))
            self.ends = numpy.concatenate((self.ends, numpy.zeros(self.steps)))
        self.powers[self.steps] = [powers.get(node, 0.0) for node in self.row]
        self.ends[self.steps + 1] = self.ends[self.steps] + dt
        self.steps += 1
