"""Expressions of ``--where``: parsed into a small set of operations, never evaluated as Python."""

import ast
import operator
from collections.abc import Callable
from typing import Any

import pandas as pd

from knitlab.maps.selection import unknown
from knitlab.sweep.faults import fault

COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
ALLOWED = "names, numbers, quoted words, + - * /, comparisons, and, or, not"


def no_column(name: str, table: pd.DataFrame) -> str:
    """Say why a table has no such column: its dimensions are not selected, or it is unknown."""
    along = set(table.attrs.get("dims", {}).get(name, ())) - set(table.columns)
    if along:
        selections = " ".join(f"--select {dim}=VALUE" for dim in sorted(along))
        return f"{name} runs along {', '.join(sorted(along))}; choose there with {selections}"
    return unknown(name, map(str, table.columns))


def holds(expression: str, table: pd.DataFrame) -> pd.Series:
    """For which rows of a table an expression over its columns is true.

    Args:
        expression: for example ``poisson_ratio_min < -0.3 and status == "ok"``.
        table: one column a variable.

    Raises:
        BadInput: if it cannot be parsed, holds anything but :data:`ALLOWED`, names a column
            that is not there, compares a word with a number, or is not a condition.
    """
    where = f"--where {expression!r}"
    try:
        tree = ast.parse(expression.strip(), mode="eval")
        truth = _value(tree.body, table, where)
    except SyntaxError as error:
        raise fault(where, f"cannot be parsed ({error.msg}); use {ALLOWED}") from error
    except (TypeError, ZeroDivisionError) as error:
        raise fault(where, f"cannot be computed ({error}); compare like with like") from error
    except RecursionError as error:
        raise fault("--where", "is too long; make it shorter") from error
    if not (isinstance(truth, pd.Series) and pd.api.types.is_bool_dtype(truth)):
        raise fault(where, "is not a condition on the designs; compare a column with something")
    # Whole numbers may be missing, and what is missing fulfils nothing.
    return truth.fillna(False).astype(bool)


def _value(node: ast.expr, table: pd.DataFrame, where: str) -> Any:
    match node:
        case ast.Name(id=name):
            if name not in table.columns:
                raise fault(where, no_column(name, table))
            return table[name]
        case ast.Constant(value=bool() | int() | float() | str() as constant):
            return constant
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand, table, where)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return ~_condition(operand, table, where)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in ARITHMETIC:
            return ARITHMETIC[type(op)](_value(left, table, where), _value(right, table, where))
        case ast.BoolOp(op=op, values=operands):
            joined = operator.and_ if isinstance(op, ast.And) else operator.or_
            truth = _condition(operands[0], table, where)
            for operand in operands[1:]:
                truth = joined(truth, _condition(operand, table, where))
            return truth
        case ast.Compare(left=left, ops=ops, comparators=comparators):
            return _comparison(left, ops, comparators, table, where)
    raise fault(where, f"holds what is not allowed here ({type(node).__name__}); use {ALLOWED}")


def _condition(node: ast.expr, table: pd.DataFrame, where: str) -> pd.Series:
    truth = _value(node, table, where)
    if not (isinstance(truth, pd.Series) and pd.api.types.is_bool_dtype(truth)):
        raise fault(where, f"{ast.unparse(node)!r} is not a condition; compare it with something")
    return truth


def _comparison(
    left: ast.expr,
    ops: list[ast.cmpop],
    comparators: list[ast.expr],
    table: pd.DataFrame,
    where: str,
) -> Any:
    values = [_value(operand, table, where) for operand in (left, *comparators)]
    if any(type(op) not in COMPARISONS for op in ops):
        raise fault(where, f"holds a comparison that is not allowed here; use {ALLOWED}")
    truths = [
        COMPARISONS[type(op)](before, after)
        for op, before, after in zip(ops, values, values[1:], strict=False)
    ]
    truth = truths[0]
    for further in truths[1:]:
        truth = truth & further
    return truth
