#!/usr/bin/python3
"""Compares what a round trip costs the hosts of each language, with the installed libraries and one server on ipc. Needs
valgrind.

languages.py --build BUILD [--nodes N] [--blocks B] [--steps S] [--count N] [--bounds]

Counted: instructions of the host's thread per step in C, C++, Fortran and by contact_law.hpp, by valgrind's callgrind, as
the difference of two runs of different length; they do not depend on the machine's load. Timed: blocks of steps in C, C++, Fortran and
Python in turn; printed are the smallest and the lower quartile of the blocks' times per step. With --bounds the exit
code tells whether the instructions agree within 5 % and Python's smallest time is at most 1.3 times that of C."""
import pathlib
import re
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "contract"))
import coupling_page  # noqa: E402
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "client/report"))
from terminal import Parser, whole_number  # noqa: E402

AGREEMENT, PYTHON_RATIO = 0.05, 1.3
SHORT = 200  # steps of the short run: past those that the closure check watches
SCENE = "constant_friction.toml"
# Each host reads numbers of steps from standard input and prints the seconds that they took.
INPUTS = "VELOCITY_JUMP PRESSURE STRESS_SOFT STRESS_HARD MASS_SOFT MASS_HARD".split()
OUTPUTS = "SHEAR_STRESS SLIDING_VELOCITY INTERFACE_TEMPERATURE VELOCITY_JUMP_NEW FRICTION_HEAT REGIME OUTCOME".split()
BYTES = ("REGIME", "OUTCOME")
VALUES = dict(zip(INPUTS, ("100.0", "0.0", "0.0", "0.0", "4.3e-3", "12.3e-3")))  # open: the jump stays
CLOCK = """#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
"""
C = f"""#define _POSIX_C_SOURCE 200809L
{CLOCK}#include <shearbus/shearbus.h>
int main(int argc, char** argv) {{
  const size_t n = argc > 1 ? (size_t)atoi(argv[1]) : 1;
  shearbus_session* bus = NULL;
  shearbus_options options = SHEARBUS_OPTIONS_INIT;
  options.scene_file = "{SCENE}";
  uint64_t* ids = malloc(n * sizeof *ids);
  for (size_t i = 0; i < n; ++i) ids[i] = i;
  if (shearbus_open(&bus, &options, n, ids, NULL, NULL)) return 1;
  double* in[{len(INPUTS)}];
  void* out[{len(OUTPUTS)}];
  const double values[] = {{{', '.join(VALUES.values())}}};
  for (int c = 0; c < {len(INPUTS)}; ++c) {{
    in[c] = malloc(n * sizeof(double));
    for (size_t i = 0; i < n; ++i) in[c][i] = values[c];
  }}
  for (int c = 0; c < {len(OUTPUTS)}; ++c) out[c] = malloc(n * sizeof(double));
  const shearbus_input inputs[] = {{{', '.join(f'{{SHEARBUS_{name}, 0, in[{i}], 0}}' for i, name in enumerate(INPUTS))}}};
  const shearbus_output outputs[] = {{{', '.join(f'{{SHEARBUS_{name}, 0, out[{i}], 0}}' for i, name in enumerate(OUTPUTS))}}};
  shearbus_request step = SHEARBUS_REQUEST_INIT;
  step.dt_s = 1e-9, step.n = n, step.inputs = inputs, step.n_inputs = {len(INPUTS)}, step.outputs = outputs, step.n_outputs = {len(OUTPUTS)};
  for (int steps; scanf("%d", &steps) == 1;) {{
    const double start = now();
    for (int i = 0; i < steps; ++i)
      if (shearbus_step(bus, &step, NULL, NULL)) return 1;
    printf("%.9f\\n", now() - start), fflush(stdout);
  }}
  return shearbus_close(&bus, NULL);
}}
"""
CXX = f"""{CLOCK}#include <shearbus/client.hpp>
int main(int argc, char** argv) {{
  const std::size_t n = argc > 1 ? std::strtoul(argv[1], nullptr, 10) : 1;
  shearbus::Options options;
  options.scene_file = "{SCENE}";
  shearbus::Ids ids(n);
  for (std::size_t i = 0; i < n; ++i) ids[i] = i;
  shearbus::Session bus(options, ids);
  shearbus::Step step(n);
  {' '.join(f'std::vector<double> v_{name}(n, {value}); step.in(SHEARBUS_{name}, v_{name});' for name, value in VALUES.items())}
  {' '.join(f'std::vector<{"std::uint8_t" if name in BYTES else "double"}> v_{name}(n); step.out(SHEARBUS_{name}, v_{name});' for name in OUTPUTS)}
  for (int steps; std::scanf("%d", &steps) == 1;) {{
    const double start = now();
    for (int i = 0; i < steps; ++i) bus.step(step.dt(1e-9));
    std::printf("%.9f\\n", now() - start), std::fflush(stdout);
  }}
  bus.close();
}}
"""
LAW = f"""#include <cstdio>
#include <cstdlib>
#include <shearbus/contact_law.hpp>
int main(int argc, char** argv) {{
  const std::size_t n = argc > 1 ? std::strtoul(argv[1], nullptr, 10) : 1;
  shearbus::Options options;
  options.scene_file = "{SCENE}";
  shearbus::Ids ids(n);
  for (std::size_t i = 0; i < n; ++i) ids[i] = i;
  shearbus::ContactLaw law(options, ids, 2);
  const double area = 2e-6;
  std::vector<shearbus::Vector> force(n);
  for (int steps; std::scanf("%d", &steps) == 1; std::printf("0\\n"), std::fflush(stdout))
    for (int i = 0; i < steps; ++i) {{
      for (const std::uint64_t id : ids)
        law.touch(id, shearbus::Contact{{{{0, 1, 0}}, {{{VALUES['VELOCITY_JUMP']}, 0, 0}}, {VALUES['PRESSURE']}, area, force[id], force[id],
                                        {VALUES['MASS_SOFT']} * area, {VALUES['MASS_HARD']} * area}});
      law.solve(1e-9);
      for (const std::uint64_t id : ids) {{
        const shearbus::Vector traction = law.traction(id);
        for (int k = 0; k < 2; ++k) force[id][k] = area * traction[k];
      }}
    }}
  law.session().close();
}}
"""
FORTRAN = f"""program host
  use shearbus
  use, intrinsic :: iso_fortran_env, only: int64, real64
  implicit none
  type(shearbus_interface) :: bus
  character(len=20) :: word
  integer :: n, i, steps, stat
  integer(int64) :: start, finish, rate
  call get_command_argument(1, word)
  read (word, *) n
  call bus%open(scene='{SCENE}', nodes=[(i, i=0, n - 1)])
  bus%jump = {VALUES['VELOCITY_JUMP']}_real64
  bus%pressure = {VALUES['PRESSURE']}_real64
  bus%stress_soft = {VALUES['STRESS_SOFT']}_real64
  bus%stress_hard = {VALUES['STRESS_HARD']}_real64
  bus%mass_soft = {VALUES['MASS_SOFT']}_real64
  bus%mass_hard = {VALUES['MASS_HARD']}_real64
  do
    read (*, *, iostat=stat) steps
    if (stat /= 0) exit
    call system_clock(start, rate)
    do i = 1, steps
      call bus%step(1e-9_real64)
    end do
    call system_clock(finish)
    print '(f0.9)', real(finish - start, real64)/real(rate, real64)
    flush (6)
  end do
  call bus%close()
end program
"""
PYTHON = f"""import sys, time
import numpy, shearbus
n = int(sys.argv[1])
names = "jump pressure stress_soft stress_hard mass_soft mass_hard".split()
inputs = {{name: numpy.full(n, value) for name, value in zip(names, ({', '.join(VALUES.values())}))}}
with shearbus.open("{SCENE}", nodes=range(n)) as bus:
    for line in sys.stdin:
        start = time.perf_counter()
        for _ in range(int(line)):
            bus.step(1e-9, **inputs)
        print(f"{{time.perf_counter() - start:.9f}}", flush=True)
"""
HOSTS = {"C": ("c", C), "C++": ("cpp", CXX), "Fortran": ("fortran", FORTRAN), "contact_law": ("cpp", LAW), "Python": ("python", PYTHON)}


def commands(page, nodes):
    """Compiles the hosts. Returns {language: command}."""
    found = {}
    for name, (language, source) in HOSTS.items():
        built = page.command(language, source, optimise="-O2")[-1]
        place = built.with_name(f"{name}-{built.name}")
        built.rename(place)
        found[name] = (["/usr/bin/python3", "-B"] if language == "python" else []) + [str(place), str(nodes)]
    return found


def instructions(command, steps, environment, examples, work):
    """Returns the instructions of the host's own thread in a run of so many steps."""
    for old in work.glob("callgrind.*"):
        old.unlink()
    subprocess.run(["valgrind", "-q", "--tool=callgrind", "--separate-threads=yes", f"--callgrind-out-file={work}/callgrind", *command],
                   input=f"{steps}\n", text=True, stdout=subprocess.DEVNULL, cwd=examples, env=environment, check=True, timeout=600)
    (host,) = work.glob("callgrind*-01")
    return int(re.search(r"^(?:totals|summary): (\d+)", host.read_text(), re.M)[1])


def alternate(found, steps, blocks, environment, examples):
    """Returns {language: seconds per step of each block}; the languages take turns."""
    hosts = {name: subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=examples, env=environment)
             for name, command in found.items()}
    times = {name: [] for name in hosts}
    for block in range(blocks + 1):
        for name, host in hosts.items():
            host.stdin.write(f"{steps if block else SHORT}\n")
            host.stdin.flush()
            times[name].append(float(host.stdout.readline()) / steps)
    for host in hosts.values():
        host.stdin.close()
        host.wait(20)
    return {name: values[1:] for name, values in times.items()}


def quartile(values):
    return sorted(values)[len(values) // 4]


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("--build", type=pathlib.Path, required=True)
    parser.add_argument("--nodes", type=whole_number, default=10)
    parser.add_argument("--blocks", type=whole_number, default=60)
    parser.add_argument("--steps", type=whole_number, default=50)
    parser.add_argument("--count", type=whole_number, default=1000, help="steps that are counted")
    parser.add_argument("--bounds", action="store_true")
    options = parser.parse_args()
    source = pathlib.Path(__file__).resolve().parents[2]
    with tempfile.TemporaryDirectory(prefix="shearbus-") as scratch:
        work = pathlib.Path(scratch)
        page = coupling_page.installed_page(options.build, source / "client/README.md", work)
        return compare(page, options, work, source / "client/examples")


def compare(page, options, work, examples):
    environment = {**page.environment, "SHEARBUS_ENDPOINT": f"ipc://{work}/bus"}
    found = commands(page, options.nodes)
    server = subprocess.Popen([page.prefix / "bin/shearbus-server", "--bind", environment["SHEARBUS_ENDPOINT"], "--log-level", "error"])
    try:
        while not (work / "bus").exists() and server.poll() is None:
            time.sleep(0.02)
        counted = {}
        for name in ("C", "C++", "Fortran", "contact_law"):
            runs = [instructions(found[name], steps, environment, examples, work) for steps in (SHORT, SHORT + options.count)]
            counted[name] = (runs[1] - runs[0]) / options.count
            print(f"{name:11} {counted[name]:9.0f} instructions a step of {options.nodes} nodes", flush=True)
        del found["contact_law"], counted["contact_law"]  # a law of vectors: it does more than the others
        times = alternate(found, options.steps, options.blocks, environment, examples)
    finally:
        server.terminate()
        server.wait(20)
    for name, values in times.items():
        print(f"{name:8} {1e3 * min(values):.4f}, {1e3 * quartile(values):.4f} ms a step (smallest block, lower quartile)")
    spread = max(counted.values()) / min(counted.values()) - 1
    ratio = {name: of(times["Python"]) / of(times["C"]) for name, of in (("smallest", min), ("lower quartile", quartile))}
    print(f"instructions differ by {100 * spread:.1f} %; Python takes, of C's time: " +
          ", ".join(f"{name} {value:.2f}" for name, value in ratio.items()))
    return options.bounds and (spread > AGREEMENT or ratio["smallest"] > PYTHON_RATIO)


if __name__ == "__main__":
    sys.exit(main())
