"""The kinds of fault, each a rule from a node of a syntax tree to its possible replacements."""

import ast
import copy
import re
from collections.abc import Callable, Iterator
from typing import Any


def _words(text: str) -> frozenset[str]:
    return frozenset(re.findall(r"\w+", text))


# Text, log lines and the appearance of pictures are excluded: a change there is no fault of a computation.
PRESENTATION = _words(
    "alpha align axis_label bbox_to_anchor c cmap color colors description dpi edgecolor encoding errors facecolor "
    "figsize file fmt fontsize fontweight framealpha ha help label labels layout linestyle linewidth linewidths loc ls "
    "lw marker markersize metavar msg name ncol newline pad pad_inches prefix radii rotation s strict text title "
    "tooltip usage va wspace hspace zorder"
)
LOGGING = frozenset({"print", "warn", "debug", "info", "warning", "exception", "log"})
# a float below this guards a division or a comparison; twice as much of it cannot be seen by construction
SMALLEST_FLOAT = 1e-6

Rule = Callable[[ast.AST], Iterator[ast.AST]]

_BOUNDARY = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_EQUALITY = {
    one: other
    for pair in ((ast.Eq, ast.NotEq), (ast.Is, ast.IsNot), (ast.In, ast.NotIn))
    for one, other in (pair, pair[::-1])
}
_ARITHMETIC = {ast.FloorDiv: ast.Mult, ast.Mod: ast.FloorDiv, ast.Pow: ast.Mult} | {
    one: other
    for pair in ((ast.Add, ast.Sub), (ast.Mult, ast.Div), (ast.BitAnd, ast.BitOr), (ast.LShift, ast.RShift))
    for one, other in (pair, pair[::-1])
}
_OTHER_NAMES = (
    *("min max", "minimum maximum", "nanmin nanmax", "argmin argmax", "any all"),
    *("sin cos", "floor ceil", "mean sum", "radians degrees", "deg2rad rad2deg"),
)
_OTHER_CALL = {"median": "mean"} | {
    one: other for pair in _OTHER_NAMES for one, other in (pair.split(), pair.split()[::-1])
}
# their arguments may change places
_SYMMETRIC = _words("min max minimum maximum fmin fmax hypot isclose allclose array_equal gcd logaddexp samefile")


def called(node: ast.AST) -> str:
    """The last part of a called function's name, empty when it has none."""
    if not isinstance(node, ast.Call):
        return ""
    function = node.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str | bytes))


def _has_text(node: ast.AST) -> bool:
    """Whether text is put together or formatted here."""
    if isinstance(node, ast.BinOp):
        return _has_text(node.left) or _has_text(node.right)
    return _has_text(node.value) if isinstance(node, ast.AugAssign) else _is_text(node)


def _swap_comparison(table: dict[type, type]) -> Rule:
    def rule(node: ast.AST) -> Iterator[ast.AST]:
        if not isinstance(node, ast.Compare):
            return
        for place, operator in enumerate(node.ops):
            if (other := table.get(type(operator))) is not None:
                changed = copy.deepcopy(node)
                changed.ops[place] = other()
                yield changed

    return rule


def _arithmetic(node: ast.AST) -> Iterator[ast.AST]:
    if not isinstance(node, ast.BinOp | ast.AugAssign) or (other := _ARITHMETIC.get(type(node.op))) is None:
        return
    if _has_text(node):
        return
    changed = copy.deepcopy(node)
    changed.op = other()
    yield changed


def _accumulation(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.AugAssign):
        yield ast.Assign(targets=[copy.deepcopy(node.target)], value=copy.deepcopy(node.value))


def _sign(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield copy.deepcopy(node.operand)


def _not(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield copy.deepcopy(node.operand)


def _boolean(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.BoolOp):
        changed = copy.deepcopy(node)
        changed.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield changed
        for place in range(len(node.values)):
            rest = [copy.deepcopy(value) for other, value in enumerate(node.values) if other != place]
            yield rest[0] if len(rest) == 1 else ast.BoolOp(op=copy.deepcopy(node.op), values=rest)


def _constant(node: ast.AST) -> Iterator[ast.AST]:
    if not isinstance(node, ast.Constant):
        return
    value = node.value
    if isinstance(value, bool):
        yield ast.Constant(value=not value)
    elif isinstance(value, int):
        yield ast.Constant(value=0 if value == 1 else value + 1)
    elif isinstance(value, float) and value == 0.0:
        yield ast.Constant(value=1.0)
    elif isinstance(value, float) and abs(value) >= SMALLEST_FLOAT and value < float("inf"):
        yield ast.Constant(value=2.0 * value)


def _condition(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.If | ast.IfExp | ast.While):
        tests: tuple[ast.expr, ...] = (ast.UnaryOp(op=ast.Not(), operand=copy.deepcopy(node.test)),)
        if not isinstance(node, ast.While):
            tests += (ast.Constant(value=True), ast.Constant(value=False))
        for test in tests:
            changed = copy.deepcopy(node)
            changed.test = test
            yield changed
    elif isinstance(node, ast.comprehension) and node.ifs:
        unfiltered = copy.deepcopy(node)
        unfiltered.ifs = []
        yield unfiltered


def _statement(node: ast.AST) -> Iterator[ast.AST]:
    is_call = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    is_kept_state = (
        isinstance(node, ast.Assign)
        and len(node.targets) == 1
        and isinstance(node.targets[0], ast.Attribute | ast.Subscript)
    )
    if is_call or is_kept_state or isinstance(node, ast.Delete):
        yield ast.Pass()


def _jump(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.Continue | ast.Break):
        yield ast.Pass()


def _refusal(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.Raise):
        yield ast.Pass()


def _handler(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.ExceptHandler) and not (len(node.body) == 1 and isinstance(node.body[0], ast.Raise)):
        changed = copy.deepcopy(node)
        changed.body = [ast.Raise()]
        yield changed
    elif isinstance(node, ast.Try) and node.finalbody:
        unfinished = copy.deepcopy(node)
        unfinished.finalbody = [ast.Pass()]
        yield unfinished


def _returned(node: ast.AST) -> Iterator[ast.AST]:
    """A condition negated, a formula with the other sign, a call left out; never None, which any test finds."""
    if not isinstance(node, ast.Return) or node.value is None or isinstance(node.value, ast.Constant):
        return
    value = copy.deepcopy(node.value)
    if isinstance(value, ast.Compare | ast.BoolOp) or (
        isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not)
    ):
        yield ast.Return(value=ast.UnaryOp(op=ast.Not(), operand=value))
    elif isinstance(value, ast.BinOp) and not _has_text(value):
        yield ast.Return(value=ast.UnaryOp(op=ast.USub(), operand=value))
    elif isinstance(value, ast.Call) and value.args and isinstance(value.args[0], ast.Name | ast.Attribute | ast.Call):
        yield ast.Return(value=value.args[0])


def _arguments(node: ast.AST) -> Iterator[ast.AST]:
    if not isinstance(node, ast.Call) or len(node.args) < 2 or called(node) in _SYMMETRIC:
        return
    first, second = node.args[:2]
    if any(isinstance(argument, ast.Starred) or _is_text(argument) for argument in (first, second)):
        return
    changed = copy.deepcopy(node)
    changed.args[:2] = changed.args[1::-1]
    yield changed


def _operands(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        yield ast.BinOp(left=copy.deepcopy(node.right), op=ast.MatMult(), right=copy.deepcopy(node.left))


def _index(node: ast.AST) -> Iterator[ast.AST]:
    """An index one further, a slice's border one further."""
    if not isinstance(node, ast.Subscript):
        return
    for inner_path, inner in _constants_of_index(node.slice):
        changed = copy.deepcopy(node)
        target: Any = changed.slice
        for step in inner_path:
            target = target.elts[step] if isinstance(step, int) else getattr(target, step)
        target.value = 0 if inner.value == 1 else inner.value + 1
        yield changed


def _constants_of_index(node: ast.AST, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    if isinstance(node, ast.Constant) and isinstance(node.value, int) and not isinstance(node.value, bool):
        yield path, node
    elif isinstance(node, ast.Tuple):
        for place, element in enumerate(node.elts):
            yield from _constants_of_index(element, (*path, place))
    elif isinstance(node, ast.Slice):
        for border in ("lower", "upper"):
            if (bound := getattr(node, border)) is not None:
                yield from _constants_of_index(bound, (*path, border))
    elif isinstance(node, ast.UnaryOp):
        yield from _constants_of_index(node.operand, (*path, "operand"))


def _default(node: ast.AST) -> Iterator[ast.AST]:
    """A keyword or the default of a look-up left out; not a class's, whose fields mostly have no default."""
    if not isinstance(node, ast.Call) or called(node)[:1].isupper():
        return
    for place, keyword in enumerate(node.keywords):
        if keyword.arg is not None and keyword.arg not in PRESENTATION:
            changed = copy.deepcopy(node)
            del changed.keywords[place]
            yield changed
    at_least = {"get": 2, "pop": 2, "getattr": 3, "next": 2}.get(called(node))
    if at_least is not None and len(node.args) == at_least:
        changed = copy.deepcopy(node)
        del changed.args[-1]
        yield changed


def _other_call(node: ast.AST) -> Iterator[ast.AST]:
    if (other := _OTHER_CALL.get(called(node))) is None:
        return
    changed = copy.deepcopy(node)
    assert isinstance(changed, ast.Call)
    if isinstance(changed.func, ast.Attribute):
        changed.func.attr = other
    elif isinstance(changed.func, ast.Name) and other in ("min", "max", "any", "all"):
        changed.func.id = other
    else:
        return
    yield changed


RULES: dict[str, Rule] = {
    "boundary": _swap_comparison(_BOUNDARY),
    "equality": _swap_comparison(_EQUALITY),
    "arithmetic": _arithmetic,
    "accumulation": _accumulation,
    "sign": _sign,
    "not": _not,
    "boolean": _boolean,
    "constant": _constant,
    "condition": _condition,
    "statement": _statement,
    "jump": _jump,
    "refusal": _refusal,
    "handler": _handler,
    "returned": _returned,
    "arguments": _arguments,
    "operands": _operands,
    "index": _index,
    "default": _default,
    "call": _other_call,
}
