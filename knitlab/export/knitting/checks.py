"""Checks of a program: a machine's state, followed operation by operation.

What they find, and what is left to the back end of a machine: ``docs/how-to/knit.md``.
"""

from dataclasses import dataclass, field

from knitlab.export.knitting.machine import Machine
from knitlab.export.knitting.program import OF_CARRIERS, Needle, Operation, operations
from knitlab.io.errors import Mistake

MAX_STITCHES_HELD = 2  # on a needle: a loop and a tuck
MAX_STITCHES_JOINED = 3  # on a needle: its loop, one of a decrease, and one of a bind-off


@dataclass(frozen=True)
class FormedStitch:
    """A stitch of a knit graph, formed on the needle at a position of the front or back bed."""

    position: int
    front: bool
    carriers: tuple[int, ...]  # of its loops, in the order of the operation
    through: tuple[int, ...]  # numbers of the stitches it was pulled through, none of a tuck


def check(text: str, machine: Machine) -> tuple[list[Mistake], list[FormedStitch]]:
    """Mistakes of a program on a machine by line, and the stitches that it forms, in order."""
    state = _State(machine, _header_mistakes(text, machine))
    for operation in operations(text):
        if not operation.opcode.startswith("x-"):
            state.follow(operation)
    state.finish()
    return state.mistakes, state.graph


def _header_mistakes(text: str, machine: Machine) -> list[Mistake]:
    lines = text.split("\n")
    mistakes = []
    if not lines[0].startswith(";!knitout-"):
        mistakes.append(Mistake(f"line 1: {lines[0]}", "is not ;!knitout-2; begin with that"))
    width = f";;Width: {machine.needles}"
    why = "Position: Center means the middle of another machine's beds without it"
    carriers = f";;Carriers: {' '.join(map(str, range(1, machine.listed_carriers + 1)))}"
    hint = "keep to its count of carriers, or choose another machine by model"
    for header, message in (
        (width, f"is not {width}; write this line, because {why}"),
        (carriers, f"{machine.back_end} takes only {carriers}; {hint}"),
    ):
        name = header.partition(" ")[0]
        stated = [(k, line) for k, line in enumerate(lines, 1) if line.startswith(name)]
        if not stated:
            mistakes.append(Mistake("header", message))
        elif stated[-1][1] != header:
            mistakes.append(Mistake(f"line {stated[-1][0]}: {stated[-1][1]}", message))
    return mistakes


@dataclass
class _State:
    machine: Machine
    mistakes: list[Mistake] = field(default_factory=list)
    graph: list[FormedStitch] = field(default_factory=list)
    held: dict[Needle, list[int]] = field(default_factory=dict)
    active: set[int] = field(default_factory=set)
    unused: set[int] = field(default_factory=set)  # brought in, without a stitch yet
    hooked: int | None = None  # carrier that the inserting hook holds
    hook_from: int | None = None  # first needle that is behind the hook
    racking: int = 0
    now: Operation = field(default_factory=lambda: Operation(1, "", ()))

    def follow(self, operation: Operation) -> None:
        """Take the state on by an operation, by the method of its name."""
        self.now = operation
        machine = self.machine
        last = machine.needles
        outside = [each for each in operation.needles if not 1 <= each.number <= last]
        for needle in outside:
            self._report(f"{needle} is outside the needles 1 to {last}; move or narrow the fabric")
        if operation.opcode in OF_CARRIERS and operation.opcode.endswith("hook") != machine.hooks:
            own = f"{machine.bring_in} and {machine.bring_out}"
            self._report(f"{machine.back_end} takes only {own}; use these")
        if not outside:
            named = (*operation.needles, *map(int, operation.carriers))
            getattr(self, f"_{operation.opcode}")(*named)

    def finish(self) -> None:
        """Find what is left over."""
        if self.hooked is not None:
            self._report(f"ends while the hook holds carrier {self.hooked}; release it")
        for carrier in sorted(self.active):
            hint = f"add {self.machine.bring_out} {carrier}"
            self._report(f"ends while carrier {carrier} is in action; {hint}")
        if left := sorted(str(needle) for needle, loops in self.held.items() if loops):
            more = f" and {len(left) - 1} others" if len(left) > 1 else ""
            self._report(f"ends while {left[0]}{more} hold loops; bind them off or drop them")

    def _report(self, message: str) -> None:
        self.mistakes.append(Mistake(f"line {self.now.line}: {self.now}", message))

    def _opposite(self, needle: Needle) -> Needle:
        shift = -self.racking if needle.front else self.racking
        return Needle(not needle.front, needle.number + shift)

    def _check_carriers(self, needle: Needle, carriers: tuple[int, ...]) -> None:
        most = self.machine.carriers_of_a_stitch
        if len(carriers) > most or len(set(carriers)) < len(carriers):
            self._report(f"has {len(carriers)} carriers; take at most {most}")
        for carrier in carriers:
            if carrier not in self.active:
                hint = f"bring it in by {self.machine.bring_in} {carrier}"
                self._report(f"carrier {carrier} is not in action; {hint}")
        if self.hook_from is not None and needle.number >= self.hook_from:
            message = f"the inserting hook with carrier {self.hooked} is in the way"
            self._report(f"{message}; put releasehook {self.hooked} before this line")
            self.hooked = self.hook_from = None
        for carrier in [each for each in carriers if each in self.unused]:
            first = f"the first stitch of carrier {carrier}"
            if carriers != (carrier,):
                message = f"{first} also has other carriers, which {self.machine.back_end} refuses"
                self._report(f"{message}; tuck with carrier {carrier} alone before")
            words = "leftwards", "rightwards"
            inwards, outwards = words if self.machine.hooks else words[::-1]
            if self.now.direction != ("-" if self.machine.hooks else "+"):
                hint = f"yarn is brought in {inwards}: begin with a stitch {inwards}"
                self._report(f"{first} goes {outwards}; {hint}")
        self.unused.difference_update(carriers)
        if self.hooked in carriers and self.hook_from is None:
            self.hook_from = needle.number + 1

    def _knit(self, needle: Needle, *carriers: int) -> None:
        self._check_carriers(needle, carriers)
        through = self.held.pop(needle, [])
        across = self._opposite(needle)
        if self.held.get(across):
            state = "too" if through else "and this needle holds none"
            message = f"{across} holds a loop of this wale, {state}"
            self._report(f"{message}; transfer it before knitting here")
        elif not through:
            self._report("knits on a needle without a loop; cast on there, or keep its loop")
        conductors = [each for each in carriers if each in self.machine.electrode_carriers]
        if len(conductors) > 1:
            self._report("joins the conductors of two electrodes; knit with one of them")
        elif conductors and (body := self.machine.body_carrier) not in carriers:
            self._report(f"knits a conductor alone; plate it with the body's carrier {body}")
        self._form(needle, carriers, tuple(sorted(through)))

    def _tuck(self, needle: Needle, *carriers: int) -> None:
        self._check_carriers(needle, carriers)
        if len(self.held.get(needle, [])) >= MAX_STITCHES_HELD:
            self._report(f"{needle} holds {MAX_STITCHES_HELD} loops already; knit them first")
        self._form(needle, carriers, ())

    def _form(self, needle: Needle, carriers: tuple[int, ...], through: tuple[int, ...]) -> None:
        self.held.setdefault(needle, []).append(len(self.graph))
        self.graph.append(FormedStitch(needle.number, needle.front, carriers, through))

    def _xfer(self, source: Needle, target: Needle) -> None:
        if self._opposite(source) != target:
            opposite = f"{source} is opposite {self._opposite(source)} at racking {self.racking}"
            self._report(f"{opposite}; rack before, or correct the needles")
        moved = self.held.pop(source, [])
        there = self.held.get(target, [])
        if not moved:
            self._report(f"{source} holds no loop; transfer only where the bed changes")
        elif there and (not self.racking or len(moved) + len(there) > MAX_STITCHES_JOINED):
            self._report(f"{target} already holds a loop; knit or move that first")
        self.held[target] = [*there, *moved]

    def _drop(self, needle: Needle) -> None:
        dropped = self.held.pop(needle, [])
        for carrier in (each for number in dropped for each in self.graph[number].carriers):
            if carrier in self.active:
                message = f"drops a loop of carrier {carrier}, which is in use: the wale runs"
                self._report(f"{message}; drop after outhook {carrier}")

    def _check_hook_is_free(self) -> None:
        if (held := self.hooked) is not None:
            self._report(f"the hook still holds carrier {held}; put releasehook {held} before")

    def _in(self, carrier: int) -> None:
        if carrier in self.active:
            self._report(f"carrier {carrier} is in action already; remove the line")
        if carrier > self.machine.carriers:
            self._report(f"the machine has {self.machine.carriers} carriers; name one of them")
        self.active.add(carrier)
        self.unused.add(carrier)

    def _out(self, carrier: int) -> None:
        if carrier not in self.active:
            self._report(f"carrier {carrier} is not in action; remove the line")
        self.active.discard(carrier)

    def _inhook(self, carrier: int) -> None:
        self._check_hook_is_free()
        self._in(carrier)
        self.hooked = carrier
        self.hook_from = None

    def _releasehook(self, carrier: int) -> None:
        if carrier != self.hooked:
            self._report(f"the hook does not hold carrier {carrier}; remove the line")
        elif self.hook_from is None:
            self._report(f"carrier {carrier} has no stitch yet; release it after one")
        self.hooked = self.hook_from = None

    def _outhook(self, carrier: int) -> None:
        self._check_hook_is_free()
        self._out(carrier)
        self.hooked = self.hook_from = None

    def _rack(self) -> None:
        self.racking = int(self.now.parameters[0])
        if abs(self.racking) > (largest := self.machine.largest_racking):
            self._report(f"racks by more than {largest} needles; move the loops in steps")
