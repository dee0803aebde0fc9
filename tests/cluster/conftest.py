"""A SLURM of two nodes on this machine, with all its files in a folder of its own."""

import os
import shutil
import socket
import subprocess
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import psutil
import pytest

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "scontrol", "sinfo")
PATHS = os.pathsep.join([os.environ["PATH"], "/usr/sbin", "/usr/local/sbin"])
NODES = ("n1", "n2")
NOT_ENDED = {"PENDING", "RUNNING", "SIGNALING", "COMPLETING", "REQUEUED"}  # states of a task
SECONDS_TO_START = 30
SECONDS_OF_JOBS = 300
CONFIGURATION = """
ClusterName=knitlab
SlurmctldHost=localhost(127.0.0.1)
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
SlurmctldPort={control}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CredType=cred/munge
# A task that is requeued waits as long as a credential is valid, by default 120 s.
AuthInfo=socket={folder}/munge.socket,cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
MpiDefault=none
SlurmdTimeout=15
KillWait=10
ReturnToService=2
NodeName=n[1-2] NodeHostname=localhost NodeAddr=127.0.0.1 Port={ports} CPUs=1 RealMemory=4096
PartitionName=main Nodes=ALL Default=YES State=UP
"""


class Slurm:
    """The daemons of a cluster, all children of this process."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.folder = folder
        self._conf = str(folder / "slurm.conf")
        self.environment = os.environ | {"SLURM_CONF": self._conf, "PATH": PATHS}
        self._stack = stack
        self._nodes: dict[str, subprocess.Popen] = {}
        control, *ports = free_ports(1 + len(NODES))
        self._user = psutil.Process().username()
        text = CONFIGURATION.format(
            folder=folder, control=control, user=self._user, ports=",".join(map(str, ports))
        )
        (folder / "slurm.conf").write_text(text)
        (folder / "state").mkdir()
        key = folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        self._started(
            *("munged", "--foreground", "--force", f"--key-file={key}"),
            *(f"--{name}-file={folder}/munge.{name}" for name in ("seed", "pid", "log")),
            f"--socket={folder}/munge.socket",
        )
        self.wait_for(lambda: (folder / "munge.socket").exists(), SECONDS_TO_START)
        self._started("slurmctld", "-D", "-i")
        for node in NODES:
            self.start_node(node)

    def _started(self, *command: str) -> subprocess.Popen:
        log = self._stack.enter_context((self.folder / f"{command[0]}.log").open("a"))
        options = {"stdin": subprocess.DEVNULL, "stdout": log, "stderr": log}
        process = subprocess.Popen(command, env=self.environment, **options)
        self._stack.callback(process.wait)
        self._stack.callback(process.terminate)
        return process

    def __call__(self, *command: object) -> str:
        """What a program of SLURM prints."""
        done = subprocess.run(
            [*map(str, command)], env=self.environment, capture_output=True, text=True
        )
        if done.returncode:
            raise AssertionError(done.stderr.strip())
        return done.stdout.strip()

    def wait_for(self, condition, seconds=SECONDS_OF_JOBS):
        """Wait until a condition holds."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                raise AssertionError(self.logs())
            time.sleep(0.1)

    def logs(self) -> str:
        """The last lines of all daemons."""
        texts = [path.read_text().splitlines()[-20:] for path in self.folder.glob("*.log")]
        return "\n".join(line for lines in texts for line in lines)

    def start_node(self, node: str) -> None:
        """Start the daemon of a node, and wait until it is ready for jobs."""
        (self.folder / node).mkdir(exist_ok=True)
        self._nodes[node] = self._started("slurmd", "-D", "-N", node)
        self.wait_for(lambda: self.state_of(node) == "idle", SECONDS_TO_START)

    def state_of(self, node: str) -> str:
        """The state of a node."""
        return self("sinfo", "--noheader", "--nodes", node, "--format", "%T")

    def lose_node(self, node: str) -> None:
        """Kill all processes of a node."""
        self._nodes[node].kill()
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                own = process.environ()
                if (own.get("SLURM_CONF"), own.get("SLURMD_NODENAME")) == (self._conf, node):
                    parent = process.parent()
                    if parent and parent.name() == "slurmstepd":
                        parent.kill()
                    process.kill()

    def end_jobs(self) -> None:
        """Cancel all jobs, and wait until they have ended."""
        self("scancel", "--user", self._user)
        self.wait_for(lambda: not self("squeue", "--noheader"))

    def states(self, job: str) -> dict[str, str]:
        """The states of the tasks of a job by their numbers."""
        # A task that ended keeps its state for minutes.
        lines = self("squeue", "--states=all", "--array", "--noheader", "-j", job, "-o", "%K %T")
        return dict(line.split() for line in lines.splitlines())

    def ended(self, job: str) -> bool:
        """Whether all tasks of a job have ended."""
        return not {*self.states(job).values()} & NOT_ENDED


def free_ports(count: int) -> list[int]:
    """Ports of this machine that nothing uses."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A SLURM that runs; the test is skipped where its programs are missing or cannot start."""
    missing = [name for name in PROGRAMS if not shutil.which(name, path=PATHS)]
    if missing:
        pytest.skip(f"SLURM is not installed: no {missing[0]} (Debian: apt-get install slurm-wlm)")
    with ExitStack() as stack:
        folder = tmp_path_factory.mktemp("slurm")
        try:
            started = Slurm(folder, stack)
        except (AssertionError, OSError) as error:
            pytest.skip(f"SLURM cannot start on this machine: {str(error).splitlines()[-1]}")
        yield started


@pytest.fixture
def slurm(cluster, monkeypatch, tmp_path):
    """The same, for commands that a test runs in a folder of its own."""
    monkeypatch.setenv("SLURM_CONF", cluster.environment["SLURM_CONF"])
    monkeypatch.setenv("PATH", PATHS)
    monkeypatch.chdir(tmp_path)
    yield cluster
    cluster.end_jobs()
