"""Small faults that can be put into a file: a comparison, an operator, a number, a condition.

A mutant is known by its file, the function that it changes, and what becomes what, so that a list
of equivalent ones outlives other edits of the file.
"""

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

OTHER: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Mod: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.USub: ast.UAdd,
}
CALLED = {"min": "max", "max": "min", "floor": "ceil", "ceil": "floor"}
LONGEST = 60  # characters of a name's parts
UNSEEN = ("annotation", "returns", "decorator_list", "bases")  # types decide nothing


@dataclass(frozen=True)
class Mutant:
    """One fault."""

    path: str
    name: str  # file, function, "a < b -> a <= b"
    source: str  # of the whole file with it


def mutants_of(path: str, source: str) -> list[Mutant]:
    """All of a file, in the order of its lines; later ones of one name are numbered."""
    tree, found, named = ast.parse(source), [], Counter[str]()
    for function, node in _nodes(tree, ""):
        if not function:  # numbers at the top are what the method was tuned to; tests name them
            continue
        for field, new in _changes(node):
            old, before = getattr(node, field), _short(node)
            setattr(node, field, new)
            name = f"{path} {function}: {before} -> {_short(node)}"
            named[name] += 1
            number = f" ({named[name]})" if named[name] > 1 else ""
            found.append(Mutant(path, name + number, ast.unparse(tree)))
            setattr(node, field, old)
    return found


def _short(node: ast.AST) -> str:
    """What decides in long sums stands last."""
    text = ast.unparse(node)
    return text if len(text) <= LONGEST else f"..{text[-LONGEST:]}"


def _nodes(node: ast.AST, function: str) -> Iterator[tuple[str, ast.AST]]:
    """Every node below one, with the function or class around it."""
    for field, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if field in UNSEEN or not isinstance(child, ast.AST):
                continue
            within = function
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                within = f"{function}.{child.name}".lstrip(".")
            yield within, child
            yield from _nodes(child, within)


def _changes(node: ast.AST) -> Iterator[tuple[str, Any]]:
    """What may become of a node: an attribute, and its other value."""
    match node:
        case ast.Compare(ops=ops):
            for k, op in enumerate(ops):
                if type(op) in OTHER:
                    yield "ops", [*ops[:k], OTHER[type(op)](), *ops[k + 1 :]]
        case ast.BinOp(op=op) | ast.AugAssign(op=op) | ast.BoolOp(op=op) | ast.UnaryOp(op=op):
            if type(op) in OTHER:
                yield "op", OTHER[type(op)]()
            elif isinstance(node, ast.UnaryOp) and isinstance(op, ast.Not):
                yield "operand", ast.UnaryOp(ast.Not(), node.operand)
        case ast.Constant(value=bool() as value):
            yield "value", not value
        case ast.Constant(value=int() | float() as value):
            yield "value", value + 1
        case ast.Call(func=ast.Name(id=name)) if name in CALLED:
            yield "func", ast.Name(CALLED[name], ast.Load())
        case ast.Call(func=ast.Attribute(value=ast.Name(id="math") as of, attr=name)):
            if name in CALLED:
                yield "func", ast.Attribute(of, CALLED[name], ast.Load())
