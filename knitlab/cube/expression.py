"""Expressions of ``where``: parsed into a small set of operations, never evaluated as Python.

Missing values fulfil no condition and no negation of one; a division by zero gives a missing value.
"""

import ast
import operator
from collections.abc import Callable
from typing import Any

import pandas as pd

from knitlab.cube.reduced_columns import reduced_columns
from knitlab.cube.schema import VARIABLES
from knitlab.io.errors import fault, unknown

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
NOT_A_NUMBER = ("nan", "none", "null")
REDUCED = "reduced_column_"
ALLOWED = (
    "names, numbers, quoted words, + - * /, comparisons, in, and, or, not, abs(), isnan(),"
    " mean(NAME, STRAIN:STRAIN) and min, max, slope, spread"
)


def no_column(name: str, table: pd.DataFrame) -> str:
    """Message about a missing column: its dimensions are not selected, or it is unknown."""
    along = set(table.attrs.get("dims", {}).get(name, ())) - set(table.columns)
    if along:
        selections = " and ".join(f"{dim}=VALUE" for dim in sorted(along))
        return f"{name} runs along {', '.join(sorted(along))}; select {selections} to have it"
    if name in VARIABLES:
        return f"these designs have no {name}; it is a result of other workflows or settings"
    return unknown(name, map(str, table.columns), "column")


def holds(expression: str, table: pd.DataFrame) -> pd.Series:
    """Whether an expression over the columns of a table is true, for each row.

    Args:
        expression: for example ``poisson_ratio_min < -0.3 and status == "ok"``.
        table: one column for each variable; ``attrs["words"]`` has the words that columns may have.

    Raises:
        BadInput: if it cannot be parsed, contains anything but :data:`ALLOWED`, names an unknown
            column or a word that the column cannot have, compares a word with a number, or is not
            a condition.
    """
    where = f"where {expression!r}"
    plain = expression.strip()
    for place, (part, column) in enumerate(reduced_columns(plain).items()):
        # Under a name that Python can parse; different texts for one column give the same name.
        plain = plain.replace(part, f"{REDUCED}{place}")
        table = table.assign(**{f"{REDUCED}{place}": table[column.label]})
    try:
        tree = ast.parse(plain, mode="eval")
        truth = _value(tree.body, table, where)
    except SyntaxError as error:
        raise fault(where, f"cannot be parsed ({error.msg}); use {ALLOWED}") from error
    except ZeroDivisionError as error:
        raise fault(where, "cannot be computed: it divides by zero; change the divisor") from error
    except TypeError as error:
        raise fault(where, f"cannot be computed ({error}); compare like with like") from error
    except RecursionError as error:
        raise fault("where", "is too long; make it shorter") from error
    if not _is_condition(truth):
        raise fault(where, "is not a condition on the designs; compare a column with something")
    return truth.fillna(False).astype(bool)


def _value(node: ast.expr, table: pd.DataFrame, where: str) -> Any:
    match node:
        case ast.Name(id=name):
            if name.casefold() in NOT_A_NUMBER:
                raise fault(where, f"nothing equals {name}; use isnan(NAME)")
            if name not in table.columns:
                raise fault(where, no_column(name, table))
            column = table[name]
            return column.astype("Float64") if pd.api.types.is_numeric_dtype(column) else column
        case ast.Constant(value=bool() | int() | float() | str() as constant):
            return constant
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand, table, where)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return ~_condition(operand, table, where)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in ARITHMETIC:
            found = ARITHMETIC[type(op)](_value(left, table, where), _value(right, table, where))
            return _finite(found) if isinstance(found, pd.Series) else found
        case ast.BoolOp(op=op, values=operands):
            joined = operator.and_ if isinstance(op, ast.And) else operator.or_
            truth = _condition(operands[0], table, where)
            for operand in operands[1:]:
                truth = joined(truth, _condition(operand, table, where))
            return truth
        case ast.Call(func=ast.Name(id="abs"), args=[operand], keywords=[]):
            return abs(_value(operand, table, where))
        case ast.Call(func=ast.Name(id="isnan"), args=[operand], keywords=[]):
            return _column(operand, table, where).isna().astype("boolean")
        case ast.Compare(left=left, ops=[ast.In()], comparators=[ast.Tuple() | ast.List() as many]):
            return _is_one_of(left, many.elts, table, where)
        case ast.Compare(left=left, ops=ops, comparators=comparators):
            return _comparison(left, ops, comparators, table, where)
    raise fault(where, f"contains {type(node).__name__}, which is not allowed; use {ALLOWED}")


def _column(node: ast.expr, table: pd.DataFrame, where: str) -> pd.Series:
    values = _value(node, table, where)
    if not isinstance(values, pd.Series):
        raise fault(where, f"{ast.unparse(node)!r} is not a column; name one")
    return values


def _is_one_of(
    left: ast.expr, choices: list[ast.expr], table: pd.DataFrame, where: str
) -> pd.Series:
    values = _column(left, table, where)
    truth = pd.Series(False, index=values.index, dtype="boolean")
    for choice in choices:
        truth = truth | operator.eq(*_alike(values, _value(choice, table, where), table, where))
    return truth


def _finite(values: pd.Series) -> pd.Series:
    """Numbers, with missing values for divisions by zero."""
    return values.where((values - values) == 0)


def _is_condition(value: Any) -> bool:
    return isinstance(value, pd.Series) and pd.api.types.is_bool_dtype(value)


def _condition(node: ast.expr, table: pd.DataFrame, where: str) -> pd.Series:
    truth = _value(node, table, where)
    if not _is_condition(truth):
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
        raise fault(where, f"contains a comparison that is not allowed; use {ALLOWED}")
    truths = [
        COMPARISONS[type(op)](*_alike(before, after, table, where))
        for op, before, after in zip(ops, values, values[1:], strict=False)
    ]
    truth = truths[0]
    for further in truths[1:]:
        truth = truth & further
    return truth


def _alike(one: Any, other: Any, table: pd.DataFrame, where: str) -> tuple[Any, Any]:
    """Both sides of a comparison, with words checked and case-folded.

    Raises:
        BadInput: if a word is compared with a number, or its column cannot have it.
    """
    if not (_is_word(one) or _is_word(other)):
        return one, other
    if not (_is_word(one) and _is_word(other)):
        raise fault(where, "compares a word with a number; compare like with like")
    for column, word in ((one, other), (other, one)):
        if isinstance(column, pd.Series) and isinstance(word, str):
            known = table.attrs.get("words", {}).get(column.name) or column.dropna().unique()
            if word.casefold() not in {str(each).casefold() for each in known}:
                raise fault(where, f"{column.name}: {unknown(word, map(str, known))}")
    return _folded(one), _folded(other)


def _is_word(value: Any) -> bool:
    return isinstance(value, str) or (
        isinstance(value, pd.Series)
        and not pd.api.types.is_numeric_dtype(value)
        and not pd.api.types.is_bool_dtype(value)
    )


def _folded(value: Any) -> Any:
    return value.casefold() if isinstance(value, str) else value.astype("string").str.casefold()
