"""A LinuxCNC of its own for a test: real programs in namespaces of their own, on free ports.

Nothing of it is seen outside but its port: processes, shared memory, /tmp and the folder of its
modules are private, and killing its first process ends all of it at once. Works as root and as an
ordinary user where the system lets users make namespaces.
"""

import os
import random
import re
import shlex
import shutil
import signal
import socket
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import drivers

EXAMPLES = Path(__file__).parents[2] / "examples" / "linuxcnc"
DRIVERS = Path(drivers.__file__).parent
STOCK_MODULES = Path("/usr/lib/linuxcnc/modules")
STOCK_NML = Path("/usr/share/linuxcnc/linuxcnc.nml")
PROGRAMS = ("linuxcnc", "halcmd", "unshare", "nsenter", "setpriv")
NOBODY = 65534
READY_WITHIN_S = 60.0
GONE_WITHIN_S = 30.0
LOOK_AGAIN_S = 0.01

NAMESPACES = ("--fork", "--pid", "--kill-child=SIGKILL", "--mount-proc", "--ipc", "--mount")
AS_USER = ("--user", "--map-current-user", "--keep-caps")
INSIDE = """
set -e
mount --rbind "$PRIVATE" /mnt
mount --rbind /usr/lib/linuxcnc/modules /mnt/stock
mount --bind /mnt/modules /usr/lib/linuxcnc/modules
mount --bind /mnt/tmp /tmp
cd "/mnt/config/$VARIANT"
linuxcnc -r "$PWD/$INI" </dev/null >/mnt/run.log 2>&1 &
wait $!
"""


def why_not() -> str:
    """What this machine lacks to run LinuxCNC for a test; empty when nothing."""
    if missing := [name for name in PROGRAMS if shutil.which(name) is None]:
        return f"{missing[0]} is not installed"
    probe = ["unshare", *_as_user(), *NAMESPACES, "mount", "--bind", "/tmp", "/mnt"]
    tried = subprocess.run(probe, capture_output=True, text=True, check=False)
    return "" if tried.returncode == 0 else f"no namespaces here: {tried.stderr.strip()}"


class LinuxcncInstance:
    """One LinuxCNC with one of the example configurations; `start` it, and `stop` it in the end.

    `edits` are replacements in its INI file. `modules` are kinematics beside LinuxCNC's own. Its
    drives are `times_as_fast` as those of the example.
    """

    def __init__(self, folder: Path, variant: str, *, modules=(), edits=(), times_as_fast=1):
        self.port = _free_port()
        self.folder = folder
        self.config = folder / "config" / variant
        self._variant = variant
        self._ini = next((EXAMPLES / variant).glob("*.ini")).name
        self._process: subprocess.Popen | None = None
        shutil.copytree(EXAMPLES, folder / "config")
        shutil.copytree(DRIVERS, folder / "config" / "drivers")
        folder.chmod(0o755)  # its realtime part may run as another user
        _prepare_modules(folder, modules)
        self._make_tmp()
        self._adapt_ini(edits, times_as_fast)

    @property
    def url(self):
        return f"tcp://127.0.0.1:{self.port}"

    @property
    def log(self):
        """What it has said so far."""
        return (self.folder / "run.log").read_text(errors="replace")

    @property
    def init_pid(self):
        """Its first process, seen from here."""
        pid = self._process.pid
        return int(Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0])

    def start(self):
        """Start it and wait until it answers."""
        self.launch()
        return self.await_ready()

    def launch(self):
        """Start it."""
        command = ["setpriv", "--pdeathsig", "SIGKILL", "unshare", *_as_user(), *NAMESPACES]
        with (self.folder / "namespaces.log").open("w") as log:
            self._process = subprocess.Popen(
                [*command, "bash", "-c", INSIDE], env=self._environment(), stdout=log, stderr=log
            )

    def await_ready(self):
        """Wait until it answers; without an answer in time everything is stopped."""
        try:
            self._await_answer()
        except BaseException:
            self.stop()
            raise
        return self

    def stop(self):
        """Kill all of it; returns when nothing is left."""
        if self._process is None:
            return
        if self._process.poll() is None:
            os.kill(self.init_pid, signal.SIGKILL)
        self._process.wait(GONE_WITHIN_S)
        self._process = None
        shutil.rmtree(self.folder / "tmp")  # its lock, with which a next start would be slow
        self._make_tmp()

    def restart(self):
        self.stop()
        return self.start()

    def kill(self, program):
        """Kill one of its programs without any warning; returns when none of it runs."""
        find = shlex.join(["pidof", "-x", program])
        # a child of one that was killed may end by itself in between, or still be at work
        self.run("sh", "-c", f"{find} && while pids=$({find}); do kill -9 $pids; done; ! {find}")

    def hal(self, *words):
        """Run halcmd beside it; gives what it says."""
        return self.run("halcmd", *words)

    def run(self, *command):
        """Run a command beside its programs; gives what it says."""
        user = () if os.geteuid() == 0 else ("--user", "--preserve-credentials")
        spaces = ("nsenter", "-t", str(self.init_pid), *user, "--ipc", "--pid", "--mount")
        whole, surroundings = [*spaces, *command], self._environment()
        done = subprocess.run(whole, capture_output=True, text=True, check=False, env=surroundings)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        return done.stdout.strip()

    def make_ready(self):
        """Release its e-stop, switch it on and home it, as its operator does."""
        self.run("/mnt/config/make_ready.py")

    def __enter__(self):
        return self.start()

    def __exit__(self, *_):
        self.stop()

    def _make_tmp(self):
        (self.folder / "tmp").mkdir()
        (self.folder / "tmp").chmod(0o1777)

    def _await_answer(self):
        deadline_s = time.monotonic() + READY_WITHIN_S
        while not self._answers():
            assert time.monotonic() < deadline_s, self.log
            assert self._process.poll() is None, self.log
            time.sleep(LOOK_AGAIN_S)

    def _answers(self):
        with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1.0):
            return True
        return False

    def _adapt_ini(self, edits, times_as_fast):
        ini = self.config / self._ini
        nml = self.config / "own.nml"
        nml.write_text(STOCK_NML.read_text().replace("TCP=5005", f"TCP={_free_port()}"))
        text = ini.read_text().replace("--port 5020", f"--port {self.port}")
        text = text.replace("[EMC]\n", "[EMC]\nNML_FILE = own.nml\n", 1)
        for old, new in edits:
            assert old in text, old
            text = text.replace(old, new)
        limits = r"(MAX_\w+VELOCITY|MAX_VELOCITY|MAX_ACCELERATION|FERROR) = ([0-9.]+)"
        text = re.sub(limits, lambda m: f"{m[1]} = {float(m[2]) * times_as_fast}", text)
        ini.write_text(text)

    def _environment(self):
        kept = {k: v for k, v in os.environ.items() if k not in {"DISPLAY", "WAYLAND_DISPLAY"}}
        own = {
            "PRIVATE": str(self.folder),
            "VARIANT": self._variant,
            "INI": self._ini,
            "HOME": "/mnt",
            "RTAPI_FIFO_PATH": "/tmp/rtapi_fifo",
        }
        return kept | own | ({"RTAPI_UID": str(NOBODY)} if os.geteuid() == 0 else {})


def _as_user():
    return () if os.geteuid() == 0 else AS_USER


def _free_port():
    """Free port below those that the system gives to clients: none of them can take it first."""
    first_of_clients = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    for port in random.SystemRandom().sample(range(10_000, first_of_clients), 100):
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
    raise AssertionError("no free port was found")


def _prepare_modules(folder, modules):
    """A folder of LinuxCNC's modules by links, and of ours: nothing is installed."""
    (folder / "stock").mkdir()
    (folder / "modules").mkdir()
    for stock in STOCK_MODULES.iterdir():
        (folder / "modules" / stock.name).symlink_to(Path("/mnt/stock") / stock.name)
    for own in modules:
        ours = folder / "modules" / own.name
        ours.unlink(missing_ok=True)  # one that is installed gives way to the one under test
        shutil.copy(own, ours)
