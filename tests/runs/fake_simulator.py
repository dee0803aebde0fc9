"""A fake simulator: case files of the real shape, in milliseconds.

Run as a program it does what the fault tests need another process for.
"""

import hashlib
import os
import signal
import sys
import threading
from pathlib import Path

import numpy as np
import xarray as xr

from knitlab.cubes.case_file import is_undamaged, write_case_file
from knitlab.io.job_limits import threads
from knitlab.io.provenance import MODEL
from knitlab.observables.case_variables import STRIPE_PARAMETERS, variables_of
from knitlab.observables.schema import described
from knitlab.observables.status import Status
from knitlab.observables.wavelength import POINTS
from knitlab.runs.plan import make_plan
from knitlab.runs.recorded_plan import planned_designs, read_plan
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions
from knitlab.runs.status import folder_status
from tests.file_events import kill_fork

ONE_OF_XLA = os.environ.get("PJRT_NPROC")
POISONED = 8
"""n_stripe of the designs that the bad simulators fail on."""
FACTORS = 4
EVENT_BYTES = 512
"""A pipe of one page holds eight messages, so a process is at most eight messages ahead."""


def plan_of(factors=FACTORS):
    """Ten designs with a number of factors of k_t."""
    values = ",".join(f"{1 + k / 1000:g}" for k in range(factors))
    return make_plan("periodic", ("strain_max=0.06", f"k_t_factor={values}"))


def contents(case, status=Status.ok):
    """The contents of a case file, with artificial numbers that depend only on the case."""
    seed = int(hashlib.sha256(case.case_id.encode()).hexdigest()[:8], 16)
    numbers = np.random.default_rng(seed)
    sizes = {"applied_strain": len(case.applied_strain)}
    sizes |= dict(zip(("cell_y", "cell_x"), case.unit_cells, strict=True))
    sizes |= {"stripe_parameter": len(STRIPE_PARAMETERS), "boundary_point": POINTS}
    values = {
        name: (variable.dims, numbers.random([sizes[dim] for dim in variable.dims]))
        for name, variable in variables_of(case).items()
        if variable.in_cube
    }
    values["status"] = ((), np.int8(status))
    values["periods"] = ((), case.periods)
    values["case_id"] = ((), case.case_id)
    values["code"] = ((), MODEL)
    values["iterations"] = (("applied_strain",), np.ones(sizes["applied_strain"]))
    coordinates = {**case.design, "applied_strain": list(case.applied_strain)}
    dataset = described(xr.Dataset(values, coordinates))
    dataset.attrs["reason"] = "" if status is Status.ok else "synthetic"
    return dataset


def write(results, case, status=Status.ok):
    write_case_file(results, case.case_id, contents(case, status))


def simulate(results, cases, progress):
    for case in cases:
        write(results, case)
        progress(case.case_id, len(case.applied_strain))


def ran(plan, results, simulate=simulate, **options):
    return run_plan(plan, results, RunOptions(simulate=simulate, **options))


def same(one, other):
    xr.testing.assert_identical(one.drop_attrs(), other.drop_attrs())


def counts(folder):
    """Designs of the plan of a results folder by status."""
    record = read_plan(folder)
    return folder_status(folder, record["dims"], planned_designs(record), check=True).counts


def simulate_and_announce(results, cases, progress):
    """A line of standard output for every case that is written."""
    for case in cases:
        simulate(results, [case], progress)
        os.write(sys.stdout.fileno(), f"{case.case_id:<{EVENT_BYTES - 1}}\n".encode())


def _with(bad):
    def simulate_or_not(results, cases, progress):
        if any(case.design["n_stripe"] == POISONED for case in cases):
            bad()
        simulate(results, cases, progress)

    return simulate_or_not


def simulate_poisoned(results, cases, progress):
    def bad():
        raise FloatingPointError("poisoned on purpose")

    _with(bad)(results, cases, progress)


def simulate_deadly(results, cases, progress):
    _with(lambda: os.kill(os.getpid(), signal.SIGKILL))(results, cases, progress)


def simulate_endlessly(results, cases, progress):
    _with(threading.Event().wait)(results, cases, progress)


def simulate_once_lost(results, cases, progress):
    """The worker dies once, but not when the batch is run again."""
    mark = results / "died-once"
    if any(case.design["n_stripe"] == POISONED for case in cases) and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    simulate(results, cases, progress)


def simulate_and_tell_threads(results, cases, progress):
    simulate(results, cases, progress)
    (results / f"threads-{cases[0].case_id}").write_text(f"{threads()} {ONE_OF_XLA}")


def simulate_unconverged(results, cases, progress):
    for case in cases:
        bad = case.design["n_stripe"] == POISONED
        write(results, case, Status.not_converged if bad else Status.ok)


def kill_again_and_again(results, kills):
    """Run and kill alternately, each run in a fork of this process; then print the counts.

    Every second run dies in the middle of a case because its file exceeds a size; the others are
    killed at or after some change of a file. After every kill there must be at least as many valid
    case files as before.
    """
    plan = plan_of()
    random = np.random.default_rng(1)
    before, hit = set(), 0
    for number in range(kills):
        if number % 2 and len(before) < len(plan.cases):
            die_within_a_case(plan, results, int(random.integers(1, 8000)))
        else:
            kill_at_a_change(plan, results, int(random.integers(1, 50)), bool(random.integers(2)))
        after = {case_id for case_id in plan.cases if is_undamaged(results, case_id)}
        if not after >= before:
            sys.exit(f"lost {sorted(before - after)}")
        hit += len(after) < len(plan.cases)
        before = after
    print(f"{kills} kills, {hit} of them before all was done, {len(before)} cases sound")


def kill_at_a_change(plan, results, count, begun):
    """Kill a run before its change of a file of this number, or just after it has begun."""
    kill_fork(lambda: ran(plan, results), results, count, begun=begun)


def die_within_a_case(plan, results, size):
    """A run that the system ends when a case file exceeds a size [bytes]."""
    import resource  # not on Windows

    def simulate_with_little_room(*arguments):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        simulate(*arguments)

    child = os.fork()
    if not child:
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        ran(plan, results, simulate_with_little_room)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if not os.WIFSIGNALED(status):
        sys.exit(f"{size} bytes were enough for a case")


def run_here(results, workers):
    ran(plan_of(), results, simulate_and_announce, workers=workers)


if __name__ == "__main__":
    folder = Path(sys.argv[2])
    if sys.argv[1] == "kills":
        kill_again_and_again(folder, int(sys.argv[3]))
    elif sys.argv[1] == "run":
        run_here(folder, int(sys.argv[3]))
