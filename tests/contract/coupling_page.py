#!/usr/bin/python3
"""Compiles and runs every listing of the page client/README.md, from an installed tree: each is put into a small host, two elastic
half-spaces under constant friction, which must find the exact jump without a warning. A listing with a wrong sign must be warned about.

coupling_page.py --build BUILD --page README.md --examples DIR"""
import argparse
import os
import pathlib
import re
import sys
import tempfile
import textwrap

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from installed import install, run, serving

BLOCK = re.compile(r"^```(\w+)(?: (\w+))?\n(.*?)^```", re.M | re.S)
PART = re.compile(r"^(?://|/\*|!|#) (declarations|at the start|every step|at the end|with the dump|in the process that restarts)\b.*\n", re.M)
PRESSURE = [1e8, 3e8, 5e8]  # Pa, of the three nodes
EXACT = [100.0 - 0.1 * p * sum((d * m) ** -0.5 for d, m in ((2703.0, 27.6e9), (7900.0, 77e9))) for p in PRESSURE]
TOLERANCE = 1e-6  # m/s

# The bodies of the hosts in C and C++: one column of zones behind each node; a shear wave crosses a zone in kDt.
BODIES = """
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
enum { NODES = 3, ZONES = 60, STEPS = 50 };
static const double kDt = 1e-9, kArea = 2e-6, kDensity[2] = {2703.0, 7900.0}, kModulus[2] = {27.6e9, 77e9};
static double v[2][NODES][ZONES + 1], s[2][NODES][ZONES];
static double mass(int b) { return kArea * 0.5 * kDt * sqrt(kDensity[b] * kModulus[b]); }
static void forces(double* soft, double* hard) {
  for (int i = 0; i < NODES; ++i) soft[i] = kArea * s[0][i][0], hard[i] = -kArea * s[1][i][0];
}
static void advance(double dt, const double* soft, const double* hard) {
  for (int b = 0; b < 2; ++b)
    for (int i = 0; i < NODES; ++i) {
      const double sign = b == 0 ? 1.0 : -1.0;
      v[b][i][0] += dt / mass(b) * (b == 0 ? soft : hard)[i];
      for (int j = 1; j < ZONES; ++j) v[b][i][j] += sign * dt * kArea / (2 * mass(b)) * (s[b][i][j] - s[b][i][j - 1]);
      for (int j = 0; j < ZONES; ++j) s[b][i][j] += sign * sqrt(kDensity[b] * kModulus[b]) * (v[b][i][j + 1] - v[b][i][j]);
    }
}
static void begin(void) {
  for (int i = 0; i < NODES; ++i)
    for (int j = 0; j <= ZONES; ++j) v[0][i][j] = 100.0;
}
static int show(void) {
  for (int i = 0; i < NODES; ++i) printf("%.9f\\n", v[0][i][0] - v[1][i][0]);
  return 0;
}
"""
CXX = BODIES + """
#include <cstring>
#include <shearbus/client.hpp>
static double v_soft[NODES], v_hard[NODES];
static void steps(int from, int to, double& time, const std::size_t n, shearbus::Session& bus, @arguments@) {
  const std::vector<double> area(n, kArea), m_soft(n, mass(0)), m_hard(n, mass(1));
  std::vector<double> force_soft(n), force_hard(n);
  bool rejected = true;
  for (int t = from; t < to;) {
    const double dt = t == 0 ? 0.5 * kDt : kDt;
    for (int i = 0; i < NODES; ++i) v_soft[i] = v[0][i][0], v_hard[i] = v[1][i][0];
    forces(force_soft.data(), force_hard.data());
    rejected = t % 3 == 0 && !rejected, (void)rejected;
    @step@
    advance(dt, force_soft.data(), force_hard.data());
    time += dt;
    ++t;
  }
}
int main() {
  const shearbus::Ids ids = {7, 8, 9};
  const std::size_t n = NODES;
  const std::vector<double> pressure = {1e8, 3e8, 5e8};
  double time = 0.0;
  begin();
  @start@
  @run@
  @end@
  return show();
}
"""
CXX_ARRAYS = "jump stress_soft stress_hard mass_soft mass_hard stress".split()
CXX_ARGUMENTS = ", ".join(["shearbus::Step& step", *(f"std::vector<double>& {name}" for name in CXX_ARRAYS)])
CXX_STEPS = f"steps({{}}, {{}}, time, n, bus, step, {', '.join(CXX_ARRAYS)});"
# The host goes on after its dump. What it does then is forgotten: the restarted one begins at the dump.
RESTART = f"""{CXX_STEPS.format(0, 20)}
  @dump@
  static double v_dump[2][NODES][ZONES + 1], s_dump[2][NODES][ZONES];
  const double time_dump = time;
  std::memcpy(v_dump, v, sizeof v), std::memcpy(s_dump, s, sizeof s);
  {CXX_STEPS.format(20, 30)}
  std::memcpy(v, v_dump, sizeof v), std::memcpy(s, s_dump, sizeof s), time = time_dump;
  {{
    @restart@
    {CXX_STEPS.format(20, "STEPS")}
    bus.close();
  }}
  return show();"""
C = BODIES + """
#include <shearbus/shearbus.h>
static void stop(const char* text, const char* remedy) { fprintf(stderr, "%s\\n%s\\n", text, remedy), exit(1); }
int main(void) {
  enum { n = NODES };
  const uint64_t ids[] = {7, 8, 9};
  const double pressure[] = {1e8, 3e8, 5e8};
  double jump[n], stress_soft[n], stress_hard[n], mass_soft[n], mass_hard[n], stress[n], soft[n], hard[n], time = 0.0;
  begin();
  @start@
  for (int t = 0; t < STEPS; ++t) {
    const double dt = t == 0 ? 0.5 * kDt : kDt;
    forces(soft, hard);
    for (int i = 0; i < n; ++i) {
      jump[i] = v[0][i][0] - v[1][i][0];
      stress_soft[i] = soft[i] / kArea, stress_hard[i] = -hard[i] / kArea;
      mass_soft[i] = mass(0) / kArea, mass_hard[i] = mass(1) / kArea;
    }
    @step@
    for (int i = 0; i < n; ++i) soft[i] -= stress[i] * kArea, hard[i] += stress[i] * kArea;
    advance(dt, soft, hard);
    time += dt;
  }
  @end@
  return show();
}
"""
# Velocities at half steps, or with @newmark@ true at whole steps: then the bodies have displacements.
FORTRAN = """program host
  @use@
  use, intrinsic :: iso_fortran_env, only: real64
  implicit none
  @declarations@
  integer, parameter :: n = 3, zones = 60, ids(n) = [7, 8, 9]
  logical, parameter :: newmark = @newmark@
  real(real64), parameter :: full = 1e-9_real64, gamma = 0.5_real64, density(2) = [2703.0_real64, 7900.0_real64]
  real(real64), parameter :: z(2) = sqrt(density*[27.6e9_real64, 77e9_real64]), side(2) = [1, -1], area(n) = 2e-6_real64
  real(real64), parameter :: pressure(n) = [1e8_real64, 3e8_real64, 5e8_real64]
  real(real64) :: v(0:zones, n, 2), a(0:zones, n, 2), s(0:zones - 1, n, 2), m(n, 2), dt, time, start(0:zones, n, 2)
  real(real64) :: u(0:zones, n, 2), m_soft(n), m_hard(n)
  real(real64), dimension(n) :: v_soft, v_hard, v_star_soft, v_star_hard, force_soft, force_hard
  integer :: b, t
  m = spread(0.5_real64*full*z, 1, n)*area(1)
  m_soft = m(:, 1)
  m_hard = m(:, 2)
  v(:, :, 1) = 100
  v(:, :, 2) = 0
  a = 0
  s = 0
  u = 0
  time = 0
  @start@
  do t = 1, 50
    dt = merge(0.5_real64*full, full, t == 1 .and. .not. newmark)
    start = v
    if (newmark) then
      u = u + dt*v + 0.5_real64*dt**2*a
      v = v + (1 - gamma)*dt*a
      do b = 1, 2
        s(:, :, b) = side(b)*z(b)/full*(u(1:, :, b) - u(:zones - 1, :, b))
      end do
    end if
    v_soft = start(0, :, 1)
    v_hard = start(0, :, 2)
    v_star_soft = v(0, :, 1)
    v_star_hard = v(0, :, 2)
    force_soft = area*s(0, :, 1)
    force_hard = -area*s(0, :, 2)
    @step@
    a(0, :, 1) = force_soft/m_soft
    a(0, :, 2) = force_hard/m_hard
    do b = 1, 2
      a(1:zones - 1, :, b) = side(b)/(full*z(b))*(s(1:, :, b) - s(:zones - 2, :, b))
    end do
    v = v + merge(gamma, 1.0_real64, newmark)*dt*a
    if (.not. newmark) then
      do b = 1, 2
        s(:, :, b) = s(:, :, b) + side(b)*z(b)*(v(1:, :, b) - v(:zones - 1, :, b))
      end do
    end if
    time = time + dt
  end do
  print '(f0.9)', v(0, :, 1) - v(0, :, 2)
  @end@
end program
"""
PYTHON = """
import numpy, shearbus
ids, pressure, area = [7, 8, 9], numpy.array([1e8, 3e8, 5e8]), numpy.full(3, 2e-6)
z = [(2703.0 * 27.6e9) ** .5, (7900.0 * 77e9) ** .5]
m_soft, m_hard = (numpy.full(3, 2e-6 * .5e-9 * impedance) for impedance in z)
v, s, time = numpy.zeros((2, 3, 61)), numpy.zeros((2, 3, 60)), 0.0
v[0] = 100.0
@start@
for t in range(50):
    dt = .5e-9 if t == 0 else 1e-9
    v_soft, v_hard, force_soft, force_hard = v[0, :, 0], v[1, :, 0], area * s[0, :, 0], -area * s[1, :, 0]
    @step@
    for b, (side, force, mass) in enumerate(((1, force_soft, m_soft), (-1, force_hard, m_hard))):
        v[b, :, 0] += dt * force / mass
        v[b, :, 1:-1] += side * dt / (1e-9 * z[b]) * numpy.diff(s[b])
        s[b] += side * z[b] * numpy.diff(v[b])
    time += dt
print(*(f"{jump:.9f}" for jump in v[0, :, 0] - v[1, :, 0]), sep="\\n")
@end@
"""


def parts(listing):
    """Returns {heading: lines} of a listing, whose comments "at the start", "every step", ... are the headings."""
    pieces = PART.split(listing)
    assert len(pieces) > 1 and not pieces[0].strip(), f"a listing without headings:\n{listing}"
    return dict(zip(pieces[1::2], pieces[2::2]))


def filled(template, **values):
    """Puts each value at its mark in the template, with the indentation of the mark."""
    for name, value in values.items():
        template = re.sub(rf"^( *)@{name}@", lambda m: textwrap.indent(value, m[1]).rstrip() or "", template, flags=re.M)
        template = template.replace(f"@{name}@", value)
    assert not (left := re.search(r"@\w+@", template)), left
    return template


class Page:
    def __init__(self, text, prefix, work):
        self.text, self.blocks = text, {(m[1], m[2] or ""): m[3] for m in BLOCK.finditer(text)}
        self.prefix, self.work, self.used = prefix, work, set()
        (config,) = prefix.rglob("shearbus.pc")
        words = lambda *flags: run("pkg-config", *flags, "shearbus", env={**os.environ, "PKG_CONFIG_PATH": str(config.parent)}).stdout.split()
        self.flags, self.libraries, (self.module,) = words("--cflags"), words("--libs"), words("--variable=fortran_source")
        (library,) = prefix.rglob("libshearbus.so.1")
        self.environment = {**os.environ, "LD_LIBRARY_PATH": str(library.parent),
                            "PYTHONPATH": str(prefix / "lib/python3/dist-packages")}

    def listing(self, language, name=""):
        self.used.add((language, name))
        return self.blocks[language, name]

    def cxx(self, steps, **more):
        listing = parts(self.listing("cpp"))
        return filled(CXX, arguments=CXX_ARGUMENTS, start=listing["at the start"],
                      step=steps(listing["every step"]), end=listing["at the end"], run=CXX_STEPS.format(0, "STEPS"), **more)

    def sources(self):
        """Yields (name, language, source, whether a server of its own process is needed)."""
        call = "bus.step(step.dt(dt).time(time + dt));\n"
        yield "cpp", "cpp", self.cxx(lambda steps: steps), False
        trial = parts(self.listing("cpp", "trial"))["every step"]
        with_trial = self.cxx(lambda steps: steps.replace(call, trial))
        assert "bus.trial" in with_trial
        yield "cpp trial", "cpp", with_trial, False
        restart = parts(self.listing("cpp", "restart"))
        source = self.cxx(lambda steps: steps).replace(CXX_STEPS.format(0, "STEPS"), RESTART)
        yield "cpp restart", "cpp", filled(source, dump=restart["with the dump"], restart=restart["in the process that restarts"]), True
        listing = parts(self.listing("c"))
        yield "c", "c", filled(C, start=listing["at the start"], step=listing["every step"], end=listing["at the end"]), False
        plain = parts(self.listing("fortran"))
        uses, declarations = (textwrap.dedent("".join(line for line in plain["declarations"].splitlines(True)
                                                      if line.startswith("use ") == is_use)) for is_use in (True, False))
        newmark = parts(self.listing("fortran", "newmark"))
        for name, start, step in (("fortran", "", plain["every step"]), ("fortran newmark", newmark["at the start"], newmark["every step"])):
            yield name, "fortran", filled(FORTRAN, use=uses, declarations=declarations, start=plain["at the start"] + start, step=step,
                                          end=plain["at the end"], newmark=".true." if start else ".false."), False
        listing = parts(self.listing("python"))
        yield "python", "python", filled(PYTHON, start=listing["at the start"], step=listing["every step"], end=listing["at the end"]), False

    def command(self, language, source, optimise="-O0"):
        """Compiles a source. Returns the command that runs it."""
        file = self.work / f"host.{ {'cpp': 'cpp', 'c': 'c', 'fortran': 'f90', 'python': 'py'}[language]}"
        file.write_text(source)
        if language == "python":
            return ["/usr/bin/python3", "-B", file]
        compiler, module = {"cpp": (["g++", "-std=c++17"], []), "c": (["gcc", "-std=c99"], []),
                            "fortran": (["gfortran", "-std=f2008", "-Wno-unused-dummy-argument"], [self.module])}[language]
        warnings = ["-Wall", "-Wextra", "-Werror"] if language != "fortran" else [f"-J{self.work}"]
        run(*compiler, optimise, *warnings, *self.flags, *module, file, *self.libraries, "-lm", "-o", self.work / "host")
        return [self.work / "host"]

    def play(self, language, source, examples, endpoint=None, **options):
        environment = {**self.environment, **({"SHEARBUS_ENDPOINT": endpoint} if endpoint else {})}
        return run(*self.command(language, source), cwd=examples, env=environment, **options)


def faults(page, examples, endpoint):
    """Yields what is wrong with the listings."""
    wrong = None
    for name, language, source, needs_server in page.sources():
        done = page.play(language, source, examples, endpoint if needs_server else None)
        found = [float(word) for word in done.stdout.split()]
        if len(found) != len(EXACT) or max(abs(f - e) for f, e in zip(found, EXACT)) > TOLERANCE:
            yield f"{name}: found {found}, exact {EXACT}"
        if done.stderr:
            yield f"{name}: {done.stderr}"
        wrong = source.replace("-force_hard / area", "force_hard / area") if name == "python" else wrong
    said = page.play("python", wrong, examples, fails=True).stderr
    if "stress_hard has the wrong sign" not in said:
        yield f"a wrong sign of stress_hard was not noticed: {said}"
    text = page.listing("python", "velocity_driven")
    said = page.play("python", "import shearbus\n" + text, examples).stdout.strip()
    if said != "142.649 MPa, 1218.946 K":
        yield f"python velocity_driven: prints {said}"
    for language, name in sorted(set(page.blocks) - page.used - {("sh", "")}):
        yield f"{language} {name}: no test runs this listing"


def installed_page(build, page, work):
    """Installs the build into a directory below `work`. Returns the Page that is tested with it."""
    install(build, work / "prefix", "server", "runtime", "development", "python")
    return Page(page.read_text(), work / "prefix", work)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("build", "page", "examples"):
        parser.add_argument(f"--{name}", type=pathlib.Path, required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="shearbus-") as scratch:
        work = pathlib.Path(scratch)
        page = installed_page(options.build, options.page, work)
        with serving(page.prefix, work / "bus") as endpoint:
            found = list(faults(page, options.examples.resolve(), endpoint))
    print("\n".join(found) if found else f"{len(page.used)} listings compile, run and find the exact jump")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
