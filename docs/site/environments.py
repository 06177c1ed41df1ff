"""A page per environment in Farama's form, of its docstring and its registration."""

from __future__ import annotations

import html
import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from importlib import import_module
from typing import Any, Final

import gymnasium

from tiago_mj import ENVIRONMENTS
from tiago_mj.envs.arguments import SimulationArguments
from tiago_mj.envs.flat import core_of
from tiago_mj.models import names

#: Sections of a docstring, in their order on a page.
SECTIONS: Final = (
    "Description",
    "Action Space",
    "Observation Space",
    "Rewards",
    "Starting State",
    "Episode End",
    "Arguments",
    "Version History",
)
_ROLE: Final = re.compile(r":(?:class|func|meth|data|mod|attr|exc):`~?([^`]+)`")
_ARGUMENT: Final = re.compile(r"^(\*{0,2}[a-z_]+(?:, [a-z_]+)*): (.*)$")
#: Arguments that the registration decides, not the user.
DECIDED: Final = frozenset({"item", "load_cells"})


def task_class(name: str) -> type:
    """The class that an id makes."""
    module, attribute = ENVIRONMENTS[name].task.split(":")
    return getattr(import_module(module), attribute)


def plain(text: str) -> str:
    """Markdown of a docstring's text: Sphinx roles and double ticks as code."""
    return _ROLE.sub(lambda found: f"`{found[1].rpartition('tiago_mj.')[2]}`", text).replace("``", "`")


def sections(kind: type) -> dict[str, str]:
    """Parts of a class's docstring by their heading; the summary is under ``""``."""
    parts = re.split(r"^## (.+)$", inspect.cleandoc(kind.__doc__ or ""), flags=re.MULTILINE)
    found = {"": parts[0].strip()}
    found.update({title.strip(): text.strip() for title, text in zip(parts[1::2], parts[2::2], strict=True)})
    return found


def arguments(docstring: str) -> dict[str, str]:
    """What a docstring says under ``Args:``, of a dataclass under ``Attributes:``, by argument; several that share a
    text have it each."""
    lines = inspect.cleandoc(docstring).split("\n")
    heading = next((one for one in ("Args:", "Attributes:") if one in lines), None)
    if heading is None:
        return {}
    found: dict[str, list[str]] = {}
    sharing: list[str] = []
    for line in lines[lines.index(heading) + 1 :]:
        if line and not line.startswith("    "):
            break
        told = _ARGUMENT.match(line.strip()) if not line.startswith("     ") else None
        if told:
            sharing = told[1].split(", ")
            found.update({name: [told[2]] for name in sharing})
        else:
            for name in sharing:
                found[name].append(line.strip())
    return {name: " ".join(words).strip() for name, words in found.items() if not name.startswith("*")}


def defaults(kind: type) -> dict[str, Any]:
    """Default of every argument, the class's own before those of its bases."""
    found: dict[str, Any] = {}
    for base in kind.__mro__:
        if "__init__" in vars(base) and base.__module__.startswith("tiago_mj."):
            for name, given in inspect.signature(base.__init__).parameters.items():  # type: ignore[misc]
                if given.default is not inspect.Parameter.empty:
                    found.setdefault(name, given.default)
    for one in fields(SimulationArguments):
        found.setdefault(one.name, one.default)
    return found


def told(kind: type) -> dict[str, str]:
    """What is said of every argument, the class's own before those of its bases."""
    found: dict[str, str] = {}
    for base in kind.__mro__:
        if base.__module__.startswith("tiago_mj."):
            for doc in (getattr(vars(base).get("__init__"), "__doc__", None), base.__doc__):
                for name, text in arguments(doc or "").items():
                    found.setdefault(name, text)
    for name, text in arguments(SimulationArguments.__doc__ or "").items():
        found.setdefault(name, text)
    return found


def argument_table(name: str) -> str:
    """The arguments of ``gymnasium.make`` for an id: default and meaning."""
    kind = task_class(name)
    known, texts, registered = defaults(kind), told(kind), ENVIRONMENTS[name].arguments
    rows = ["| argument | default | meaning |", "|---|---|---|"]
    for argument, text in texts.items():
        if argument in DECIDED or (argument not in known and argument not in registered):
            continue
        value = registered.get(argument, known.get(argument))
        rows.append(f"| `{argument}` | {_shown(argument, value)} | {plain(text).replace('|', chr(92) + '|')} |")
    return "\n".join(rows)


def _shown(argument: str, value: Any) -> str:
    if argument == "joints":
        return f"{len(value)} joints"
    if isinstance(value, float):
        return f"`{value:g}`"
    return f"`{value!r}`".replace("|", "\\|")


def _space(space: gymnasium.Space[Any]) -> str:
    if isinstance(space, gymnasium.spaces.Dict):
        return ", ".join(f"`{key}`: {_space(one)}" for key, one in space.items())
    assert isinstance(space, gymnasium.spaces.Box)
    edges = ""
    if (space.low == space.low.flat[0]).all() and (space.high == space.high.flat[0]).all():
        edges = f"{space.low.flat[0]:g}, {space.high.flat[0]:g}, "
    return f"`Box({edges}{space.shape}, {space.dtype})`"


def form(name: str) -> str:
    """A sentence on the form in which an id is observed."""
    relative = ENVIRONMENTS[name].relative
    if relative is None:
        return "This id has the goal form: observations are dictionaries, as hindsight replay wants them."
    if relative == 0:
        return "Observations are one vector."
    return f"Observations are one vector. Its last {relative} entries have the goal subtracted."


def facts(name: str, env: gymnasium.Env[Any, Any]) -> list[tuple[str, str]]:
    """What the environment itself says: label and value."""
    core: Any = core_of(env)
    rate = 1 / core.dt
    steps = ENVIRONMENTS[name].steps
    rows = [
        ("make", f'`gymnasium.make("tiago_mj/{name}")`'),
        ("many at once", f'`gymnasium.make_vec("tiago_mj/{name}", num_envs=64)`'),
        ("robot", f"`{argument_of(name, 'robot')}`, {len(core.joints)} commanded joints"),
        ("action", _space(env.action_space)),
        ("observation", _space(env.observation_space)),
        ("episode", f"{steps} steps at {rate:g} Hz: {steps / rate:.3g} s"),
        ("class", f"`{task_class(name).__module__}.{task_class(name).__name__}`"),
    ]
    return rows


def facts_table(rows: list[tuple[str, str]]) -> str:
    """Labels and values as a table without a heading, which Markdown has none of."""

    def coded(text: str) -> str:
        return re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text, quote=False))

    body = "".join(f"<tr><th>{label}</th><td>{coded(value)}</td></tr>" for label, value in rows)
    return f'<table class="facts" markdown="0"><tbody>{body}</tbody></table>'


def limits(core: Any) -> str:
    """The joints that an id commands, with the limit of each, as a table."""
    rows = ["| entry | joint | unit | limit |", "|---|---|---|---|"]
    slides = core.wiring().targets.slides
    for k, joint in enumerate(core.joints):
        limit = "no effect" if k in core.drive.held else f"{core.velocity_limit[k]:g}"
        if joint in names.FINGERS and k not in core.drive.held:
            limit += " (`finger_speed`)"
        rows.append(f"| {k} | {joint} | {'m/s' if slides[k] else 'rad/s'} | {limit} |")
    return "\n".join(rows)


def of_its_own(text: str, joints: int, length: int) -> str:
    """A docstring's text on a space for one id: N is its number of joints, rows of entries that it lacks are left out.

    Args:
        text: Markdown.
        joints: that the id commands.
        length: of ``observation``.
    """

    def counted(found: re.Match[str]) -> str:
        return str(int(found[1] or 1) * joints + int((found[2] or "").replace("−", "-") or 0))

    def there(line: str) -> bool:
        first = re.match(r"\| (\d+)", line)
        return first is None or int(first[1]) < length

    text = re.sub(r"(?<![A-Za-z·(])(\d*)N([+-]\d+)?(?![A-Za-z/·)])", counted, text)
    text = re.sub(r"\(N,\)", f"({joints},)", text)
    return "\n".join(line for line in text.split("\n") if there(line))


def in_own_units(text: str, slides: Sequence[bool]) -> str:
    """A table of observations with the units that the id's joints have: of joints that all slide metres alone."""
    if not all(slides):
        return text
    return text.replace("| m, rad |", "| m |").replace("| m/s, rad/s |", "| m/s |")


def flat(text: str) -> str:
    """What a docstring says of the goal form's ``observation``, for an id that is observed as one vector: without what
    is said of dictionaries and their other entries."""
    kept = [part for part in text.split("\n\n") if not part.startswith("`achieved_goal`")]
    return re.sub(r"^(?:A d|D)ictionary[^\n]*:$", "Its entries:", "\n\n".join(kept), flags=re.MULTILINE)


def without_others(text: str) -> str:
    """What a docstring says of a space, without the paragraph on other ids."""
    return "\n\n".join(part for part in text.split("\n\n") if not part.startswith("The ids without"))


def without_tables(text: str) -> str:
    """A text without its tables."""
    lines = (line for line in text.split("\n") if not line.startswith("|"))
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip()


def argument_of(name: str, argument: str) -> Any:
    """An argument's value where the user gives none."""
    return ENVIRONMENTS[name].arguments.get(argument, defaults(task_class(name)).get(argument))


def page(name: str, picture: bool) -> str:
    """The page of an id, in Markdown."""
    kind = task_class(name)
    parts = sections(kind)
    missing = [title for title in SECTIONS if title not in parts]
    if missing:
        raise ValueError(f"the docstring of {kind.__name__} has no section {missing[0]}: write one")
    lines = [f"# {name}", plain(parts[""])]
    if picture:
        lines.append(f"![{name}, an episode]({name}.webp){{ width=480 height=360 }}")
    env = gymnasium.make(f"tiago_mj/{name}")
    core: Any = core_of(env)
    spaces = core.observation_space["observation"], env.observation_space
    lines.append(facts_table(facts(name, env)))
    for title in SECTIONS:
        lines.append(f"## {title}")
        if title == "Arguments":
            lines += ["Of `gymnasium.make`; all are given by name.", argument_table(name)]
            continue
        text = plain(parts[title])
        if title == "Action Space":
            text = f"{of_its_own(without_tables(text), len(core.joints), 0)}\n\n{limits(core)}"
        if title == "Observation Space":
            lines.append(form(name))
            text = of_its_own(text, len(core.joints), spaces[0].shape[0])
            text = in_own_units(text, core.wiring().targets.slides)
            text = without_others(text) if isinstance(spaces[1], gymnasium.spaces.Dict) else flat(without_others(text))
        lines.append(text)
    env.close()
    return "\n\n".join(lines) + "\n"


def families() -> Mapping[str, tuple[str, ...]]:
    """Ids by what they are about, in the order of the table."""
    groups: dict[str, list[str]] = {"Grasping with force": [], "Closing": [], "Reach, push, pick and place": []}
    for name in ENVIRONMENTS:
        task = ENVIRONMENTS[name].task
        key = "Closing" if "close:" in task else "Grasping with force" if "hold" in task else list(groups)[2]
        groups[key].append(name)
    return {title: tuple(ids) for title, ids in groups.items()}


def overview(picture: bool) -> str:
    """The page that lists every id."""
    lines = [
        "# Environments",
        f"There are {len(ENVIRONMENTS)}, all under `tiago_mj/`. `import tiago_mj` registers them with gymnasium. "
        "Each steps alone (`gymnasium.make`) or as many at once (`gymnasium.make_vec`), bit for bit the same.",
    ]
    for title, ids in families().items():
        lines += [f"## {title}", '<div class="tiles" markdown="0">']
        lines += list(_tiles(ids, picture))
        lines.append("</div>")
    return "\n\n".join(lines) + "\n"


def _tiles(ids: tuple[str, ...], picture: bool) -> Iterator[str]:
    for name in ids:
        seen = f'<img src="{name}.png" alt="" loading="lazy" width="320" height="240">' if picture else ""
        summary = plain(sections(task_class(name))[""]).replace("`", "")
        yield f'<a class="tile" href="{name}.html">{seen}<b>{name}</b><span>{summary}</span></a>'
