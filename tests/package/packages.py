"""Builds the Debian packages of a build tree and looks at what is in them. With --clean-root it also installs them into a new Debian 12 and
uses them there; with --systemd it boots systemd in such a system and uses the service; with --container it builds the container file by buildah,
on such a system, and uses the image. Exit code 77: a program that this needs is missing, and the last line says which."""
import argparse
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import exports

SKIPPED = 77
PACKAGES = {"shearbus-server": "amd64", "libshearbus1": "amd64", "libshearbus-dev": "amd64", "python3-shearbus": "all", "shearbus-doc": "all"}
# Some files of each package; every package has its copyright and its changelog in addition.
FILES = {
    "shearbus-server": ["usr/bin/shearbus-server", "usr/bin/shearbus-ctl", "usr/bin/shearbus-replay", "usr/bin/shearbus-report",
                        "usr/share/shearbus/report/report.html", "usr/share/man/man1/shearbus-report.1.gz",
                        "usr/lib/systemd/system/shearbus-server.service", "usr/share/man/man1/shearbus-ctl.1.gz",
                        "usr/share/bash-completion/completions/shearbus-ctl", "usr/share/shearbus/slurm/one_node.sbatch",
                        "usr/share/shearbus/slurm/job.sh"],
    "libshearbus1": ["usr/lib/libshearbus.so.1", "usr/lib/libshearbus-embedded.so.1", "usr/lib/libshearbus-checkpoint.so.1"],
    "libshearbus-dev": ["usr/include/shearbus/shearbus.h", "usr/include/shearbus/client.hpp", "usr/include/shearbus/friction_law.h",
                        "usr/lib/libshearbus.so", "usr/lib/pkgconfig/shearbus.pc", "usr/lib/cmake/shearbus/shearbusConfig.cmake",
                        "usr/share/shearbus/shearbus.f90", "usr/share/shearbus/shearbus_contract.inc"],
    "python3-shearbus": ["usr/lib/python3/dist-packages/shearbus/__init__.py", "usr/lib/python3/dist-packages/shearbus/_contract.py"],
    "shearbus-doc": ["usr/share/doc/shearbus/client/examples/host.py", "usr/share/doc/shearbus/client/signs.svg"],
}
DEPENDS = {
    "shearbus-server": ["libzmq5", "libhdf5-103-1", "libprotobuf32", "libspdlog1.10-fmt9", "adduser"],
    "libshearbus1": ["libzmq5", "libc6"],
    "libshearbus-dev": ["libshearbus1 (= "],
    "python3-shearbus": ["python3-numpy", "libshearbus1"],
    "shearbus-doc": [],
}

# What a user does with the packages, in a root that has never seen the sources.
SMOKE = r"""
set -eu
export HOME=/srv
id shearbus >/dev/null
shearbus-server --bind ipc:///run/bus/s --endpoint-file /run/endpoint --state-dir /srv/states --log-file /srv/log & server=$!
shearbus-ctl wait --server file:///run/endpoint
scene=/usr/share/doc/shearbus/client/examples/constant_friction.toml
cat > /srv/host.py <<'END'
import sys, shearbus
with shearbus.open(sys.argv[1], range(3), "file:///run/endpoint") as bus:
    print(bus.step(1e-9, jump=10.0, pressure=1e8, stress_soft=0.0, stress_hard=0.0, mass_soft=1.0, mass_hard=1.0).stress)
END
python3 /srv/host.py $scene
cc -o /srv/host /usr/share/shearbus/examples/host.c $(pkg-config --cflags --libs shearbus) -lm
cc -shared -fPIC -o /srv/law.so /usr/share/shearbus/examples/friction_law.c $(pkg-config --cflags shearbus)
SHEARBUS_ENDPOINT=file:///run/endpoint /srv/host $scene
/srv/host $scene
shearbus-ctl check $scene >/dev/null
shearbus-ctl drain --exit --server file:///run/endpoint
wait $server
test ! -e /run/endpoint
dpkg --purge shearbus-server libshearbus-dev python3-shearbus shearbus-doc libshearbus1
test ! -e /usr/bin/shearbus-server
echo smoke-test-passed
"""

# Makes of a directory with a Debian system the root of namespaces of its own, and boots systemd there. The first argument is the directory.
BOOT = r"""
set -eu
root=$1
mount --bind "$root" "$root"
mount -t proc proc "$root/proc"
mount -t sysfs -o ro sysfs "$root/sys"
umount -R "$root/sys/fs/cgroup" 2>/dev/null || true
mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
for place in run tmp dev; do mount -t tmpfs -o mode=755 tmpfs "$root/$place"; done
chmod 1777 "$root/tmp"
for device in null zero full random urandom tty; do touch "$root/dev/$device"; mount --bind "/dev/$device" "$root/dev/$device"; done
mkdir "$root/dev/pts" "$root/dev/shm"
mount -t devpts -o newinstance,ptmxmode=0666 devpts "$root/dev/pts"
ln -s pts/ptmx "$root/dev/ptmx"
mount -t tmpfs tmpfs "$root/dev/shm"
exec env -i container=test PATH=/usr/sbin:/usr/bin chroot "$root" /lib/systemd/systemd --system systemd.unit=multi-user.target
"""

# What systemd does with the service: it starts, it is started again after a kill and after a hang, and it stops with a checkpoint.
SERVICE = r"""
set -eu
for moment in $(seq 100); do [ -S /run/systemd/private ] && break; sleep 0.1; done
value() { systemctl show shearbus-server --value -p "$1"; }
ctl() { setpriv --reuid shearbus --regid shearbus --clear-groups shearbus-ctl "$@"; }
bus="--server ipc:///run/shearbus/bus --timeout 30"
systemctl is-system-running --wait || true
mkdir -p /run/systemd/system/shearbus-server.service.d
printf '[Service]\nWatchdogSec=3\n' >/run/systemd/system/shearbus-server.service.d/test.conf
systemctl daemon-reload
systemctl start shearbus-server
ctl ping $bus
value StatusText | grep "listening on ipc:///run/shearbus/bus"
kill -KILL "$(value MainPID)"
ctl wait $bus
test "$(value NRestarts)" = 1
kill -STOP "$(value MainPID)"
sleep 5
ctl wait $bus
test "$(value NRestarts)" = 2
systemctl stop shearbus-server
test "$(value Result) $(value ExecMainStatus)" = "success 0"
test "$(stat -c '%U %a' /var/lib/shearbus)" = "shearbus 700"
echo service-test-passed
"""

# The server of the image, as its user and on the image's own directories.
CONTAINER = r"""
set -eu
test "$(id -u):$(id -g)" = 571:571
"$@" --log-level off & server=$!
shearbus-ctl wait --server ipc:///run/shearbus/bus
shearbus-ctl ping --server ipc:///run/shearbus/bus
test -e /var/lib/shearbus/store
shearbus-ctl drain --exit --server ipc:///run/shearbus/bus
wait $server
echo container-test-passed
"""


def run(*command, check=True, **options):
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options)
    if check and done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))} ended with {done.returncode}:\n{done.stdout[-4000:]}")
    return done.stdout


def files_of(deb):
    """Returns the paths in a package, without the directory of the architecture, which the prefix of the build decides on."""
    names = (line.split(maxsplit=5)[5].removeprefix("./").split(" -> ")[0] for line in run("dpkg-deb", "-c", deb).splitlines())
    return {re.sub(r"^usr/lib/[\w-]+-linux-gnu/", "usr/lib/", name) for name in names}


def content_faults(debs, version):
    for name, deb in debs.items():
        found = files_of(deb)
        for file in FILES[name] + [f"usr/share/doc/{name}/copyright", f"usr/share/doc/{name}/changelog.gz"]:
            if file not in found:
                yield f"{name}: has no {file}"
        yield from (f"{name}: has {file}, outside /usr" for file in found if file and not file.startswith("usr"))
        depends = run("dpkg-deb", "-f", deb, "Depends").strip()
        yield from (f"{name}: does not depend on {wanted}, found: {depends}" for wanted in DEPENDS[name] if wanted not in depends)
        if run("dpkg-deb", "-f", deb, "Version").strip() != version:
            yield f"{name}: has another version than {version}"
    owners = {}
    for name, deb in debs.items():
        for file in files_of(deb):
            if not file.endswith("/") and owners.setdefault(file, name) != name:
                yield f"{file}: in {owners[file]} and in {name}"


def symbol_faults(deb, work):
    """Compares the symbols file of the package with what its libraries export."""
    root, control = work / "runtime", work / "runtime-control"
    run("dpkg-deb", "-x", deb, root)
    run("dpkg-deb", "-e", deb, control)
    listed = (control / "symbols").read_text()
    libraries = {path.name: path for path in root.rglob("*.so.1")}
    for path in libraries.values():
        yield from exports.symbol_faults(path, listed)
    yield from (f"{library}: not in the package, which lists it" for library in sorted(exports.listed(listed).keys() - libraries.keys()))


def page_faults(deb, work):
    root = work / "server"
    run("dpkg-deb", "-x", deb, root)
    for program in ("shearbus-server", "shearbus-ctl", "shearbus-replay"):
        page = run("zcat", root / f"usr/share/man/man1/{program}.1.gz")
        wanted = [".SH NAME", "--help", "ping" if program == "shearbus-ctl" else "--"]
        yield from (f"{program}.1: has no {text}" for text in wanted if text not in page.replace("\\-", "-"))
    completed = run("bash", "-c", f"""
export PATH={root}/usr/bin:$PATH
_init_completion() {{ cur=${{COMP_WORDS[COMP_CWORD]}} words=("${{COMP_WORDS[@]}}") cword=$COMP_CWORD; }}
_filedir() {{ :; }}
source {root}/usr/share/bash-completion/completions/shearbus-ctl
try() {{ COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=(); _shearbus; echo "${{COMPREPLY[@]}}"; }}
try shearbus-ctl p; try shearbus-ctl drain --w; try shearbus-server --endp""").splitlines()
    if completed != ["ping", "--within", "--endpoint-file"]:
        yield f"the completion gives {completed}"


def lintian_faults(debs, build):
    if not shutil.which("lintian"):
        print("lintian is missing (deploy/packages/test.txt): the packages are not checked by it")
        return
    root = ["--allow-root"] if os.geteuid() == 0 else []
    # A build with another prefix than /usr has its libraries in lib, without the name of the architecture.
    installed_as_debian = "CMAKE_INSTALL_PREFIX:PATH=/usr\n" in (build / "CMakeCache.txt").read_text()
    left_out = [] if installed_as_debian else ["--suppress-tags", "pkg-config-unavailable-for-cross-compilation"]
    said = run("lintian", *root, *left_out, "--fail-on=none", *debs.values())
    yield from (line for line in said.splitlines() if line[:2] in ("E:", "W:"))


def install(debs, mirror):
    """Installs the packages into a new Debian 12 and runs SMOKE there."""
    with tempfile.TemporaryDirectory() as work:
        for deb in debs.values():
            shutil.copy(deb, work)
        hook = (f"mkdir -p $1/debs && cp {work}/*.deb $1/debs && cp {work}/smoke $1/srv/smoke && "
                "chroot $1 sh -c 'apt-get install -y --no-install-recommends /debs/*.deb python3-xxhash gcc libc6-dev pkg-config' && "
                "chroot $1 sh /srv/smoke")
        (pathlib.Path(work) / "smoke").write_text(SMOKE)
        said = run("mmdebstrap", "--variant=apt", f"--customize-hook={hook}", "bookworm", "/dev/null", *([mirror] if mirror else []), check=False)
    if "smoke-test-passed" not in said:
        yield f"the packages do not work in a new Debian 12:\n{said[-4000:]}"


def boot(debs, mirror):
    """Boots systemd in a new Debian 12 with the server's package, and runs SERVICE there."""
    with tempfile.TemporaryDirectory() as work:
        root = pathlib.Path(work) / "root"
        hook = f"cp {debs['shearbus-server']} $1/srv/server.deb && chroot $1 apt-get install -y --no-install-recommends /srv/server.deb"
        run("mmdebstrap", "--variant=minbase", "--include=systemd,systemd-sysv,dbus", f"--customize-hook={hook}", "bookworm", root,
            *([mirror] if mirror else []))
        (root / "srv/service").write_text(SERVICE)
        namespaces = ["unshare", "--mount", "--pid", "--cgroup", "--uts", "--ipc", "--fork", "--mount-proc", "--kill-child"]
        with subprocess.Popen([*namespaces, "sh", "-c", BOOT, "boot", root], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as outer:
            time.sleep(1.0)
            children = run("pgrep", "-P", outer.pid, check=False).split()
            said = run("nsenter", "-t", children[0], "-m", "-p", "-r", "-w", "sh", "/srv/service", check=False) if children else ""
            outer.kill()
            said += "" if children else outer.stdout.read()
    if "service-test-passed" not in said:
        yield f"systemd does not run the service as it should:\n{said[-4000:]}"


def container(source, mirror):
    """Builds the container file, without a registry and without another namespace than chroot, and runs the server of the image."""
    with tempfile.TemporaryDirectory() as work:
        def buildah(*words):
            return run("buildah", "--root", f"{work}/store", "--runroot", f"{work}/run", *words).strip()

        run("mmdebstrap", "--variant=minbase", "--include=ca-certificates", "bookworm", f"{work}/base.tar", *([mirror] if mirror else []))
        base = buildah("from", "scratch").splitlines()[-1]
        buildah("add", base, f"{work}/base.tar", "/")
        buildah("commit", "--rm", base, "docker.io/library/debian:bookworm")
        buildah("tag", "docker.io/library/debian:bookworm", "docker.io/library/debian:bookworm-slim")
        os.mkdir(f"{work}/context")
        run("sh", "-c", f"git ls-files -zco --exclude-standard | tar -c --null -T - | tar -x -C {work}/context", cwd=source)
        buildah("build", "--pull-never", "--isolation", "chroot", "--format", "docker", "-f", f"{work}/context/deploy/container/Containerfile",
                "-t", "shearbus-server", f"{work}/context")
        config = json.loads(buildah("inspect", "--type", "image", "shearbus-server"))["Docker"]["config"]
        for key, wanted in {"User": "571:571", "StopSignal": "SIGTERM", "Volumes": {"/var/lib/shearbus": {}}}.items():
            if config.get(key) != wanted:
                yield f"the image has {key} {config.get(key)}, expected {wanted}"
        if "ping" not in config.get("Healthcheck", {}).get("Test", []):
            yield "the image has no health check"
        made = buildah("from", "--pull-never", "shearbus-server").splitlines()[-1]
        said = buildah("run", "--isolation", "chroot", made, "--", "sh", "-c", CONTAINER, "server", *config["Entrypoint"])
        if "container-test-passed" not in said:
            yield f"the server of the image does not work:\n{said[-4000:]}"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=pathlib.Path, required=True)
    parser.add_argument("--cpack", default="cpack")
    parser.add_argument("--version", required=True)
    parser.add_argument("--clean-root", action="store_true")
    parser.add_argument("--systemd", action="store_true")
    parser.add_argument("--container", action="store_true")
    parser.add_argument("--mirror", help="of Debian, for --clean-root, --systemd and --container")
    options = parser.parse_args()
    needed = ["dpkg-deb", "dpkg-shlibdeps", "help2man"] + (["mmdebstrap"] if options.clean_root or options.systemd or options.container else [])
    absent = [program for program in needed + (["buildah"] if options.container else []) if not shutil.which(program)]
    if absent or not list(options.build.glob("man/*.1.gz")):
        print(f"skipped: {', '.join(absent) or 'the manual, which needs help2man when the build is configured,'} missing (deploy/packages/test.txt)")
        return SKIPPED
    if options.container:
        faults = list(container(pathlib.Path(__file__).resolve().parents[2], options.mirror))
        print("\n".join(faults) if faults else "the image is as it should be")
        return 1 if faults else 0
    with tempfile.TemporaryDirectory() as scratch:
        work = pathlib.Path(scratch)
        run(options.cpack, "--config", options.build / "CPackConfig.cmake", "-B", work / "packages", "-D", "CPACK_DEBIAN_COMPRESSION_TYPE=gzip",
            cwd=options.build)
        debs = {name: work / "packages" / f"{name}_{options.version}_{architecture}.deb" for name, architecture in PACKAGES.items()}
        faults = [f"{deb.name}: not built" for deb in debs.values() if not deb.exists()]
        if not faults and options.clean_root:
            faults = list(install(debs, options.mirror))
        elif not faults and options.systemd:
            faults = list(boot(debs, options.mirror))
        elif not faults:
            faults = [*content_faults(debs, options.version), *symbol_faults(debs["libshearbus1"], work),
                      *page_faults(debs["shearbus-server"], work), *lintian_faults(debs, options.build)]
    print("\n".join(faults) if faults else "the packages are as they should be")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
