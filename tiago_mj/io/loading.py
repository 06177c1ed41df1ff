"""Reading YAML and JSON that somebody else wrote: bounded in size, depth and time, and every fault is one line.

A file of a kilobyte can ask for gigabytes (aliases of aliases), a number can have more digits than Python prints, a
name can hold characters that turn a message around. Nothing here trusts a parser's own errors or a value's ``repr``.

YAML is read as version 1.1, as PyYAML does, with three differences: keys are the text that is written (``on``, ``1``),
dates are text, and a key that stands twice in a mapping is an error.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Final, NoReturn

import yaml

from tiago_mj.io.quoting import HIDDEN, one_line, quoted, unquoted

#: Of a file. The largest that this package writes or imports, a log of a motor test bench, has 0.3 MB.
MAX_BYTES: Final = 16_000_000
#: Of a file, aliases expanded: numbers, words, keys, lists and mappings. YAML takes 5 to 7 us for each.
MAX_VALUES: Final = 200_000
#: Lists and mappings within each other; what this package writes has 7.
MAX_DEPTH: Final = 32
#: Whole numbers of files fit into 64 bits, as JSON's readers of other languages have them.
MAX_WHOLE: Final = 2**63 - 1
#: Longer texts are no numbers: a double has 17 digits, a 64-bit whole number 64 binary ones.
_DIGITS: Final = 80
_DECIMAL: Final = re.compile(r"[-+]?[0-9]{1,30}\.[0-9]{0,30}")
#: The parser in C takes a twentieth of the time.
_LOADER: Final[Any] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_TAG: Final = "tag:yaml.org,2002:"

Fail = Callable[[str], NoReturn]


def load_yaml(
    path: Path | Traversable, lead: str, *, mend: str = "mend the file", error: type[Exception] = ValueError
) -> Any:
    """What a YAML file holds: dicts with keys of text, lists, text, finite or infinite numbers, booleans, None.

    Args:
        path: of the file.
        lead: how a complaint begins, such as ``map file joints.yaml is no YAML``.
        mend: how it ends.
        error: that is raised.

    Raises:
        error: the file cannot be read, is no YAML, or is beyond the limits of this module; one line.
    """
    fail = _failing(lead, mend, error)
    text = _text(path, fail)
    if len(re.findall("^%", text, re.MULTILINE)) > 2:
        fail("more than two directives: delete the lines that begin with %")
    return _guarded(lambda: _Builder(fail).build(yaml.parse(text, Loader=_LOADER)), fail)


def load_json(
    path: Path | Traversable, lead: str, *, mend: str = "mend the file", error: type[Exception] = ValueError
) -> Any:
    """What a JSON file holds; arguments and faults as of :func:`load_yaml`. NaN and Infinity are read as numbers."""
    fail = _failing(lead, mend, error)
    return parse_json(_text(path, fail), lead, mend=mend, error=error)


def parse_json(
    text: str | bytes,
    lead: str,
    *,
    mend: str = "mend it",
    error: type[Exception] = ValueError,
    most_whole: int = MAX_WHOLE,
) -> Any:
    """The same of a text, such as an option of a command or a part of an archive, with whole numbers up to a limit."""
    fail = _failing(lead, mend, error)
    if len(text) > MAX_BYTES:
        fail(f"more than {MAX_BYTES // 1_000_000} MB")

    def parse() -> Any:
        return _parsed(text if isinstance(text, str) else text.decode("utf-8-sig"), fail, most_whole)

    return _guarded(parse, fail)


def load_text(
    path: Path | Traversable, lead: str, *, mend: str = "mend the file", error: type[Exception] = ValueError
) -> str:
    """What a file of UTF-8 text holds; arguments and faults as of :func:`load_yaml`."""
    return _text(path, _failing(lead, mend, error))


def is_file(source: str | Path) -> bool:
    """Whether a text names an existing file; too long a text does not."""
    try:
        return Path(source).is_file()
    except (OSError, ValueError):
        return False


def _failing(lead: str, mend: str, error: type[Exception]) -> Fail:
    def fail(reason: str) -> NoReturn:
        raise error(f"{lead} ({one_line(reason)}): {mend}") from None

    return fail


def _text(path: Path | Traversable, fail: Fail) -> str:
    if isinstance(path, Path) and is_pipe(path):
        fail("it is a pipe, no file")
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
        if len(content) <= MAX_BYTES:
            return content.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        line = content.count(b"\n", 0, fault.start) + 1
        fail(f"line {line}: not UTF-8 text")
    except (OSError, ValueError) as fault:  # ValueError: a null character in the path
        fail(getattr(fault, "strerror", None) or str(fault))
    fail(f"more than {MAX_BYTES // 1_000_000} MB")


def is_pipe(path: Path) -> bool:
    """Whether it is a pipe, which is waited for in vain where somebody packed it into a folder; a shell's own, <(...),
    lie below /dev."""
    try:
        return path.is_fifo() and path.parts[:2] != ("/", "dev")
    except (OSError, ValueError):
        return False


def _guarded(parse: Callable[[], Any], fail: Fail) -> Any:
    """Result of a parser; any error becomes one line."""
    try:
        return parse()
    except json.JSONDecodeError as fault:
        fail(f"line {fault.lineno}: {fault.msg}")
    except yaml.MarkedYAMLError as fault:
        mark = fault.problem_mark or fault.context_mark
        fail(f"{f'line {mark.line + 1}: ' if mark else ''}{fault.problem or fault.context}")
    except yaml.reader.ReaderError as fault:
        fail(f"character {fault.character} cannot be in YAML")
    except UnicodeDecodeError:
        fail("not UTF-8 text")
    except RecursionError:
        fail(f"nested more than {MAX_DEPTH} deep")
    except MemoryError:
        fail("it takes more memory than there is")


# JSON ----------------------------------------------------------------------------------------------------------------


def _parsed(text: str, fail: Fail, most_whole: int) -> Any:
    # Every value but the first has a comma, colon or bracket of its own; some of these may be within words.
    if sum(map(text.count, ",:[{")) > 2 * MAX_VALUES:
        fail(f"more than {MAX_VALUES} values")

    def whole(digits: str) -> int:
        if len(digits) > _DIGITS or not -most_whole <= int(digits) <= most_whole:
            fail(f"line {_line(text, digits)}: the number {unquoted(digits)} is too large")
        return int(digits)

    def real(digits: str) -> float:
        number = float(digits)
        if math.isinf(number):
            fail(f"line {_line(text, digits)}: the number {unquoted(digits)} is too large")
        return number

    def mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            names = [name for name, _ in pairs]
            fail(f"the key {quoted(next(name for name in names if names.count(name) > 1))} is there twice")
        return found

    value = json.loads(text, parse_int=whole, parse_float=real, object_pairs_hook=mapping)
    _check_tree(value, fail)
    return value


def _line(text: str, part: str) -> int:
    return text.count("\n", 0, text.index(part)) + 1


def _check_tree(value: Any, fail: Fail) -> None:
    """Refuse nesting that is too deep, and text with invisible characters."""
    left = [(value, 1)]
    while left:
        one, depth = left.pop()
        if depth > MAX_DEPTH + 1:
            fail(f"nested more than {MAX_DEPTH} deep")
        if isinstance(one, str):
            _check_seen(one, fail)
        elif isinstance(one, dict):
            for key in one:
                _check_seen(key, fail)
            left += [(item, depth + 1) for item in one.values()]
        elif isinstance(one, list):
            left += [(item, depth + 1) for item in one]


def _check_seen(text: str, fail: Fail, where: str = "") -> None:
    if not text.isprintable() and (found := HIDDEN.search(text)) is not None:
        fail(f"{where}{quoted(text)} holds the character U+{ord(found[0]):04X}, which is not shown")


# YAML ----------------------------------------------------------------------------------------------------------------


class _Open:
    """A list or mapping that is being parsed."""

    def __init__(self, value: Any, anchor: str | None, count: int) -> None:
        self.value, self.anchor, self.count = value, anchor, count
        self.height = 1
        self.key: str | None = None
        self.merged: list[Any] = []


class _Builder:
    """Values built from a parser's events without recursion, however deep the file is nested."""

    def __init__(self, fail: Fail) -> None:
        self.fail = fail
        self.line = 1
        self.count = 0
        self.open: list[_Open] = []
        self.anchors: dict[str, tuple[Any, int, int] | None] = {}
        self.resolver: Any = yaml.resolver.Resolver()
        self.constructor: Any = yaml.constructor.SafeConstructor()
        self.result: Any = None

    def build(self, events: Iterable[Any]) -> Any:
        documents = 0
        for event in events:
            self.line = event.start_mark.line + 1
            if isinstance(event, yaml.ScalarEvent):
                self.scalar(event)
            elif isinstance(event, (yaml.SequenceStartEvent, yaml.MappingStartEvent)):
                self.begin(event)
            elif isinstance(event, (yaml.SequenceEndEvent, yaml.MappingEndEvent)):
                self.end()
            elif isinstance(event, yaml.AliasEvent):
                self.alias(str(event.anchor))
            elif isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    self.wrong("a second document begins (---)")
        return self.result

    def wrong(self, reason: str) -> NoReturn:
        self.fail(f"line {self.line}: {reason}")

    def add(self, count: int) -> None:
        self.count += count
        if self.count > MAX_VALUES:
            self.wrong(f"more than {MAX_VALUES} values, aliases expanded")

    def scalar(self, event: Any) -> None:
        self.add(1)
        text = event.value
        _check_seen(text, self.fail, f"line {self.line}: ")
        within = self.open[-1] if self.open else None
        if within is not None and isinstance(within.value, dict) and within.key is None:
            self.name(within, text, event.implicit[0])
            if event.anchor:
                self.anchors[event.anchor] = (text, 1, 0)
            return
        value = self.plain(event)
        if event.anchor:
            self.anchors[event.anchor] = (value, 1, 0)
        self.put(value, 0)

    def name(self, within: _Open, text: str, bare: bool) -> None:
        if text in within.value:
            self.wrong(f"the key {quoted(text)} is there twice")
        within.key = text
        if text == "<<" and bare:
            within.key = ""
            within.merged.append(None)

    def plain(self, event: Any) -> Any:
        text, tag = event.value, event.tag
        if tag is None and event.implicit[0]:
            if _DECIMAL.fullmatch(text):  # nearly all numbers, without the regular expressions of the others
                return float(text)
            tag = self.resolver.resolve(yaml.ScalarNode, text, (True, False))
        kind = (tag or f"{_TAG}str").removeprefix(_TAG)
        if kind in ("str", "!", "timestamp", "value", "merge"):
            return text
        if kind not in ("null", "bool", "int", "float"):
            self.wrong(f"the tag {quoted(tag)} is not read")
        if len(text) > _DIGITS:
            self.wrong(f"the number {unquoted(text)} is too large")
        try:
            node = yaml.ScalarNode(tag, text)
            value = getattr(self.constructor, f"construct_yaml_{kind}")(node)
        except (ValueError, KeyError, IndexError, OverflowError):
            self.wrong(f"{quoted(text)} is no {kind}")
        endless = isinstance(value, float) and math.isinf(value) and not text.lower().endswith(".inf")
        if endless or (isinstance(value, int) and abs(value) > MAX_WHOLE):
            self.wrong(f"the number {unquoted(text)} is too large")
        return value

    def begin(self, event: Any) -> None:
        self.add(1)
        if event.tag not in (None, "!", f"{_TAG}map", f"{_TAG}seq"):
            self.wrong(f"the tag {quoted(event.tag)} is not read")
        if len(self.open) >= MAX_DEPTH:
            self.wrong(f"nested more than {MAX_DEPTH} deep")
        within = self.open[-1] if self.open else None
        if within is not None and isinstance(within.value, dict) and within.key is None:
            self.wrong("a list or mapping is used as a key")
        if event.anchor:
            self.anchors[event.anchor] = None
        value: Any = {} if isinstance(event, yaml.MappingStartEvent) else []
        self.open.append(_Open(value, event.anchor, self.count - 1))

    def end(self) -> None:
        done = self.open.pop()
        value = done.value
        if done.merged:
            value = {key: item for one in reversed(done.merged) for key, item in one.items()} | value
        if done.anchor:
            self.anchors[done.anchor] = (value, self.count - done.count, done.height)
        self.put(value, done.height)

    def alias(self, anchor: str) -> None:
        if anchor not in self.anchors:
            self.wrong(f"*{unquoted(anchor)} names nothing before it")
        known = self.anchors[anchor]
        if known is None:
            self.wrong(f"*{unquoted(anchor)} is within itself")
        value, count, height = known
        self.add(count)
        if len(self.open) + height > MAX_DEPTH:
            self.wrong(f"nested more than {MAX_DEPTH} deep")
        within = self.open[-1] if self.open else None
        if within is not None and isinstance(within.value, dict) and within.key is None:
            if not isinstance(value, str):
                self.wrong("a list or mapping is used as a key")
            self.name(within, value, False)
        else:
            self.put(value, height)

    def put(self, value: Any, height: int) -> None:
        if not self.open:
            self.result = value
            return
        within = self.open[-1]
        within.height = max(within.height, height + 1)
        if isinstance(within.value, list):
            within.value.append(value)
        elif within.merged and within.merged[-1] is None:
            within.merged.pop()
            several = value if isinstance(value, list) else [value]
            if not all(isinstance(one, Mapping) for one in several):
                self.wrong("<< takes mappings")
            within.merged += several
            within.key = None
        else:
            within.value[str(within.key)] = value
            within.key = None
