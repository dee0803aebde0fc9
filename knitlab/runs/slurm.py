"""SLURM: an array job that runs the parts of a plan, by a script in its results folder."""

import json
import math
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import Mistake, invalid, raise_if_any
from knitlab.io.job_limits import ONE_THREAD
from knitlab.io.names import as_texts
from knitlab.runs.batches import Batch, Shard, split
from knitlab.runs.plan import Plan
from knitlab.runs.workflow_file import Overrides, read_overrides

SCRIPT = "submit.sh"
LOGS = "slurm"  # folder of what the parts print
OPTION = re.compile(r"([a-z][a-z-]*)(?:=([^\n]+))?")
TIME_MARGIN = 6.0  # contact took up to three times the estimate, and cores may be slow
START_SECONDS = 900.0  # to plan and to compile, at most
MEMORY_MARGIN = 1.5
GIGABYTE = 2.0**30  # SLURM's unit G
MIN_BYTES = 2 * GIGABYTE  # enough to build a cube and draw its figures
END_SECONDS = 120  # from the signal to the end of a job whose time is over


@dataclass(frozen=True)
class Submission:
    """An array job of SLURM: its script, what it asks for, and its numbers if it was submitted."""

    script: Path
    cases: int
    parts: int
    asked: dict[str, str]  # options of sbatch
    job: str | None = None  # the parts
    last: str | None = None  # the run that builds the cube and draws its figures
    warnings: Sequence[str] = ()  # of the plan


def read_options(texts: Sequence[str]) -> dict[str, str]:
    """Options of sbatch by name, from KEY or KEY=VALUE; InputError has every mistake."""
    options = {}
    mistakes = []
    for text in as_texts(texts):
        if match := OPTION.fullmatch(text):
            options[match[1]] = match[2] or ""
        else:
            message = "is not KEY or KEY=VALUE; write it as in partition=short"
            mistakes.append(Mistake(f"sbatch {text!r}", message))
    raise_if_any(mistakes)
    return options


def asked_of_slurm(plan: Plan, parts: int, cores: int, given: dict[str, str]) -> dict[str, str]:
    """What each part asks for, as options of sbatch: by the estimates, unless it is given."""
    shares = split(plan.batches, plan.cases, Shard(1, parts).count)
    if not all(shares):
        message = f"are more than the {len(plan.cases)} cases of the plan; give fewer"
        raise invalid(f"parts {parts}", message)
    seconds = max(_seconds(share, cores) for share in shares)
    memory = max(batch.estimated_bytes for share in shares for batch in share)
    minutes = math.ceil((TIME_MARGIN * seconds + START_SECONDS) / 60)
    asked = {
        "cpus-per-task": str(cores),
        "mem": f"{math.ceil(cores * max(MIN_BYTES, MEMORY_MARGIN * memory) / GIGABYTE)}G",
        "time": f"{minutes // 60:02}:{minutes % 60:02}:00",
    }
    if any(name.startswith("mem-per-") for name in given):
        del asked["mem"]  # sbatch refuses both
    return asked | given


def _seconds(share: Sequence[Batch], cores: int) -> float:
    """Time of the batches of a part on some cores [s]."""
    times = [batch.estimated_seconds for batch in share]
    return max(sum(times) / cores, *times)


def run_words(
    workflow: str, overrides: Overrides, results: Path, options: Mapping[str, Any]
) -> list[str]:
    """The arguments of ``knitlab run`` for a workflow with these settings and options."""
    words = [workflow, f"--results={results}"]
    if isinstance(overrides, Mapping):
        read, _ = read_overrides(overrides)
        overrides = [f"{each.key}={json.dumps(each.value, ensure_ascii=False)}" for each in read]
    words += [f"--set={text}" for text in overrides]
    for name, value in options.items():
        if value:
            option = f"--{name.replace('_', '-')}"
            words.append(option if value is True else f"{option}={value}")
    return words


def write_script(
    path: Path, words: Sequence[str], parts: int, cores: int, asked: dict[str, str]
) -> None:
    """Write the script of an array job whose tasks are the parts; task 0 is the whole workflow."""
    logs = path.parent.resolve() / LOGS
    logs.mkdir(parents=True, exist_ok=True)
    output = f"{logs}".replace("%", "%%") + "/%a.log"
    options = {
        "job-name": path.parent.name,
        "array": f"1-{parts}",
        "output": output,
        "open-mode": "append",  # a task that is run again
        "requeue": "",
        # To the shell, which the run replaces: by default SLURM signals only the steps of a job.
        "signal": f"B:TERM@{END_SECONDS}",
    } | asked
    run = [sys.executable, "-m", "knitlab", "run", *words, f"--workers={cores if cores > 1 else 0}"]
    lines = [
        "#!/bin/bash",
        *(
            f"#SBATCH {shlex.quote(f'--{name}={value}' if value else f'--{name}')}"
            for name, value in options.items()
        ),
        f"# Part 1 again: sbatch --array=1 {shlex.quote(str(path))}",
        "# Task 0 is a run of the whole: what the parts have left, the cube and the figures.",
        f"cd {shlex.quote(str(Path.cwd()))} || exit",
        "export " + " ".join(f"{name}={value}" for name, value in ONE_THREAD.items()),
        f'[ "$SLURM_ARRAY_TASK_ID" = 0 ] || set -- --shard="$SLURM_ARRAY_TASK_ID/{parts}"',
        f'exec {shlex.join(run)} "$@"',
    ]
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def submitted(submission: Submission) -> Submission:
    """Submit a script: the job of its parts, and a last one after them."""
    script = str(submission.script)
    job = _sbatch("the job", script)
    after = ("--array=0", f"--dependency=afterany:{job}", script)
    return replace(submission, job=job, last=_sbatch(f"a last job after job {job}", *after))


def _sbatch(what: str, *words: str) -> str:
    """Submit a job; returned is its number. InputError if SLURM refuses it, or is not there."""
    try:
        done = subprocess.run(["sbatch", "--parsable", *words], capture_output=True, text=True)
    except FileNotFoundError:
        hint = "submit on a machine with SLURM, or make a dry run, which only writes the script"
        raise invalid("sbatch", f"is not a program of this machine; {hint}") from None
    if done.returncode:
        reason = "; ".join(done.stderr.replace("sbatch: ", "").splitlines())
        raise invalid("sbatch", f"refuses {what} ({reason}); change the option that it names")
    return done.stdout.strip().partition(";")[0]
