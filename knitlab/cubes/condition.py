"""Conditions of ``where``: expressions over the columns of a table, of a few operations of pandas.

Nothing is evaluated as Python. Missing values fulfil neither a condition nor its negation, and a
division by zero gives a missing value, unlike in ``DataFrame.eval``.
"""

import ast
import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Any

import pandas as pd

from knitlab.cubes.strain_window import check_length, reduced_columns
from knitlab.io.errors import invalid, unknown
from knitlab.observables.schema import STRAIN, VARIABLES

OPERATIONS: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    **{ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge},
    **{ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.And: operator.and_, ast.Or: operator.or_},
    **{ast.Add: operator.add, ast.Sub: operator.sub},
    **{ast.Mult: operator.mul, ast.Div: operator.truediv},
}
NOT_A_NUMBER = ("nan", "none", "null")
ALLOWED = (
    "names, numbers, quoted words, + - * /, comparisons, in, and, or, not, abs(), isnan(),"
    " mean(NAME, STRAIN:STRAIN) and min, max, slope, spread"
)


def no_column(name: str, table: pd.DataFrame) -> str:
    """Message about a missing column: its dimensions are not selected, or it is unknown."""
    along = set(table.attrs.get("dims", {}).get(name, ())) - set(table.columns)
    if along:
        selections = " and ".join(f"{dim}=VALUE" for dim in sorted(along))
        reduced = f", or reduce it, as mean({name}, 0.05:0.25)" if along == {STRAIN} else ""
        runs = f"{name} runs along {', '.join(sorted(along))}"
        return f"{runs}; select {selections} to have it{reduced}"
    if name in VARIABLES:
        return f"these designs have no {name}; it is a result of other workflows or settings"
    return unknown(name, map(str, table.columns), "column")


def holds(expression: str, table: pd.DataFrame) -> pd.Series:
    """Whether an expression over the columns of a table is true for each row.

    The attribute ``words`` of the table has the words that columns may have.
    """
    where = f"where {expression!r}"
    truth = _evaluated(expression, table, where)
    if not _is_condition(truth):
        raise invalid(where, "is not a condition on the designs; compare a column with something")
    return truth.fillna(False).astype(bool)


def computed(expression: str, table: pd.DataFrame, source: str) -> pd.Series:
    """A column that an expression over others gives, missing where it is infinite."""
    values = _evaluated(expression, table, source)
    if not isinstance(values, pd.Series):
        raise invalid(source, "is one value for all designs; name a column")
    return values if _is_condition(values) else values.astype(float)


def _evaluated(expression: str, table: pd.DataFrame, where: str) -> Any:
    plain = expression.strip()
    check_length(plain, where.partition(" ")[0])
    for number, column in enumerate(reduced_columns(plain)):
        # Under a name that Python can parse.
        plain = plain.replace(column, f"reduced_column_{number}")
        table = table.assign(**{f"reduced_column_{number}": table[column]})
    try:
        return _Evaluation(table, where).value(ast.parse(plain, mode="eval").body)
    except SyntaxError as error:
        raise invalid(where, f"cannot be parsed ({error.msg}); use {ALLOWED}") from error
    except ZeroDivisionError as error:
        message = "cannot be computed: it divides by zero; change the divisor"
        raise invalid(where, message) from error
    except (TypeError, OverflowError) as error:
        raise invalid(where, f"cannot be computed ({error}); compare like with like") from error
    except RecursionError as error:
        raise invalid(where.partition(" ")[0], "is too long; make it shorter") from error


@dataclass(frozen=True)
class _Evaluation:
    """The evaluation of an expression over a table; ``where`` begins the messages."""

    table: pd.DataFrame
    where: str

    def value(self, node: ast.expr) -> Any:
        match node:
            case ast.Name(id=name):
                return self._column(name)
            case ast.Constant(value=str() as word):
                return word.casefold()
            case ast.Constant(value=bool() | int() | float() as number):
                return number
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.value(operand)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return ~self._condition(operand)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATIONS:
                value = OPERATIONS[type(op)](self.value(left), self.value(right))
                # Missing where infinite.
                return value.where((value - value) == 0) if isinstance(value, pd.Series) else value
            case ast.BoolOp(op=op, values=operands):
                return reduce(OPERATIONS[type(op)], map(self._condition, operands))
            case ast.Call(func=ast.Name(id="abs"), args=[operand], keywords=[]):
                return abs(self.value(operand))
            case ast.Call(func=ast.Name(id="isnan"), args=[operand], keywords=[]):
                values = self.value(operand)
                if not isinstance(values, pd.Series):
                    raise invalid(self.where, f"{ast.unparse(operand)!r} is not a column; name one")
                return values.isna().astype("boolean")
            case ast.Compare(ops=[ast.In()], comparators=[ast.Tuple() | ast.List() as choices]):
                truths = [self._compared(ast.Eq, node.left, choice) for choice in choices.elts]
                return reduce(operator.or_, truths, False)
            case ast.Compare(ops=ops) if all(type(op) in OPERATIONS for op in ops):
                sides = zip(ops, pairwise([node.left, *node.comparators]), strict=True)
                return reduce(operator.and_, (self._compared(type(op), *two) for op, two in sides))
        message = f"contains {type(node).__name__}, which is not allowed; use {ALLOWED}"
        raise invalid(self.where, message)

    def _column(self, name: str) -> pd.Series:
        if name.casefold() in NOT_A_NUMBER:
            raise invalid(self.where, f"nothing equals {name}; use isnan(NAME)")
        if name not in self.table.columns:
            raise invalid(self.where, no_column(name, self.table))
        column = self.table[name]
        if pd.api.types.is_numeric_dtype(column):
            return column.astype("Float64")
        return column.astype("string").str.casefold()

    def _condition(self, node: ast.expr) -> pd.Series:
        truth = self.value(node)
        if not _is_condition(truth):
            message = f"{ast.unparse(node)!r} is not a condition; compare it with something"
            raise invalid(self.where, message)
        return truth

    def _compared(self, op: type[ast.cmpop], left: ast.expr, right: ast.expr) -> Any:
        one = self.value(left)
        other = self.value(right)
        if _is_word(one) != _is_word(other):
            raise invalid(self.where, "compares a word with a number; compare like with like")
        for sides in ((left, right), (right, left)):
            match sides:
                case ast.Name(id=name), ast.Constant(value=str() as word):
                    known = self.table.attrs.get("words", {}).get(name)
                    known = [str(each) for each in known or self.table[name].dropna().unique()]
                    if word.casefold() not in map(str.casefold, known):
                        raise invalid(self.where, f"{name}: {unknown(word, known)}")
        return OPERATIONS[op](one, other)


def _is_condition(value: Any) -> bool:
    return isinstance(value, pd.Series) and pd.api.types.is_bool_dtype(value)


def _is_word(value: Any) -> bool:
    return isinstance(value, str) or (
        isinstance(value, pd.Series) and pd.api.types.is_string_dtype(value)
    )
