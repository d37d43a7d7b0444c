"""Classes of settings: each field states type, range, default, unit and meaning of a setting once.

The library's own settings are such classes, and the configuration of a campaign is composed of
them. A number stays as it was written, 60 or 60.0, since settings are kept with the results.
"""

import math
import textwrap
from collections.abc import Mapping
from functools import cache
from inspect import Parameter, Signature, cleandoc
from typing import Annotated, Any, ClassVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
    WrapValidator,
    create_model,
    model_serializer,
)
from pydantic.fields import FieldInfo

from cislunar.errors import ConfigurationError
from cislunar.quantities import in_unit
from cislunar.runtime.settings_words import faults_of_arguments


def _without_docstring(schema: dict[str, Any]) -> None:
    schema.pop("description", None)


class _Shown(type(BaseModel)):
    """Settings classes whose help has the public names of their own."""

    def __dir__(cls) -> list[str]:
        others = {name for base in cls.__mro__[1:] for name in vars(base)}
        return [name for name in super().__dir__() if name[0] != "_" and name not in others]


class Section(BaseModel, metaclass=_Shown):
    """Settings that belong together; no other keys than the fields are allowed.

    In Python the fields are arguments in their order, and an impossible value raises a
    `ConfigurationError`. An omitted argument without a default has the paper's value if that is a
    number, or is a section of such values.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, json_schema_extra=_without_docstring)

    omitted: ClassVar[tuple[str, ...]] = ()
    """Keys that are left out of the settings kept with results while they have their defaults."""

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Show the arguments in help by their names and defaults, and their meanings and units."""
        cls.__signature__ = Signature(
            [
                Parameter(key, Parameter.KEYWORD_ONLY, default=_shown_default(field))
                for key, field in cls.model_fields.items()
            ]
        )
        if cls.__doc__ and "__doc__" in vars(cls):  # None under python -OO
            meant = [_meaning(key, field) for key, field in cls.model_fields.items()]
            cls.__doc__ = "\n".join([cleandoc(cls.__doc__), "\nParameters\n----------", *meant])

    def __init__(self, *values: Any, **given: Any) -> None:
        keys = list(type(self).model_fields)[: len(values)]
        twice = [key for key in keys if key in given]
        if len(values) > len(keys) or twice:
            raise ConfigurationError(
                f"{type(self).__name__}: {twice[0]} is given twice"
                if twice
                else f"{type(self).__name__}: {len(values)} values are given; it has only "
                f"{', '.join(keys)}"
            )
        given |= dict(zip(keys, values, strict=True))
        usual = {key: _of_paper(field) for key, field in type(self).model_fields.items()}
        given = {key: value for key, value in usual.items() if value is not None} | given
        cls = type(self)
        try:
            super().__init__(**{key: cls.in_own_unit(key, value) for key, value in given.items()})
        except ValidationError as error:
            raise ConfigurationError(faults_of_arguments(error, type(self))) from None

    # The configuration is validated without `__init__`, so that a fault keeps its key.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def in_own_unit(cls, key: str, value: Any) -> Any:
        """A number of Python for a scalar of NumPy, or for a quantity of `astropy.units` in the
        unit of the setting."""
        field = cls.model_fields.get(key)
        extra = field.json_schema_extra if field else None
        value = in_unit(key, value, extra.get("unit", "") if isinstance(extra, dict) else "")
        if hasattr(value, "tolist"):
            return value.tolist()
        return value

    @classmethod
    def kept(cls, settings: Mapping[str, Any]) -> dict[str, Any]:
        """The settings of this section as they are kept with results, without `omitted` keys."""
        found = {}
        for key, value in settings.items():
            field = cls.model_fields[key]
            usual, kind = field.default, field.annotation
            if isinstance(usual, Section):
                usual = usual.model_dump()
            if key in cls.omitted and value == usual:
                continue
            nested = isinstance(kind, type) and issubclass(kind, Section)
            found[key] = kind.kept(value) if nested else value
        return found


class _OfPaper:
    """A section with the paper's values, in help."""

    def __init__(self, kind: type) -> None:
        self.kind = kind

    def __repr__(self) -> str:
        return f"{self.kind.__name__}()"


def _meaning(key: str, field: FieldInfo) -> str:
    """Name, unit and meaning of an argument, for help; the class of a section without a meaning."""
    extra, kinds = field.json_schema_extra, (field.annotation, *get_args(field.annotation))
    unit = extra.get("unit", "") if isinstance(extra, dict) else ""
    named = (each.__name__ for each in kinds if isinstance(each, type))
    words = field.description or f"see `{next(named)}`"
    lines = textwrap.wrap(f"{words[0].upper()}{words[1:]}.", 92, break_on_hyphens=False)
    return "\n    ".join([f"{key} : {unit}" if unit not in ("", "1") else key, *lines])


def _shown_default(field: FieldInfo) -> Any:
    """Default of an argument in help; that of the paper if there is no other."""
    if not field.is_required():
        return field.default
    kind = field.annotation
    if isinstance(kind, type) and issubclass(kind, Section):
        return _OfPaper(kind)
    paper = _of_paper(field)
    return Parameter.empty if paper is None else paper


def _of_paper(field: FieldInfo) -> Any:
    """The paper's value of an argument without a default; None if there is no such value."""
    kind, extra = field.annotation, field.json_schema_extra
    if not field.is_required():
        return None
    if isinstance(kind, type) and issubclass(kind, Section):
        try:
            return kind()
        except ConfigurationError:
            return None  # not every argument of the section may be omitted
    paper = extra.get("paper") if isinstance(extra, dict) else None
    return None if isinstance(paper, str) else paper


def _without_defaults(schema: dict[str, Any]) -> None:
    _without_docstring(schema)
    for each in schema["properties"].values():
        each.pop("default", None)


class Partial(Section):
    """A section of which any key may be omitted; it has the given ones."""

    model_config = ConfigDict(json_schema_extra=_without_defaults)

    @model_serializer(mode="wrap")
    def _given(self, handler) -> dict[str, Any] | None:
        if self is None:  # an omitted key, whose default is no value
            return None
        return {key: value for key, value in handler(self).items() if key in self.model_fields_set}


@cache
def partial(model: type[Section], only: tuple[str, ...] = ()) -> type[Partial]:
    """The same keys, or some of them, with the same ranges, none of them required."""
    fields = {}
    for key in only or model.model_fields:
        field = model.model_fields[key]
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, Section) and not issubclass(kind, Partial):
            kind = partial(kind)
        kind = Annotated[kind, *field.metadata] if field.metadata else kind
        extra = field.json_schema_extra
        fields[key] = kind, Field(None, description=field.description, json_schema_extra=extra)
    name = f"{model.__name__}{'Part' if only else ''}Change"
    return create_model(name, __base__=Partial, **fields)


def setting(
    meaning: str, unit: str = "", paper: str | float = "", *, default: Any = ..., name: str = "NAME"
) -> Any:
    """A key: its meaning, unit, the paper's value, and a default where config.yaml need not say.
    Without a default the key is required in a configuration; in Python it has the paper's value if
    that is a number. `name` stands for the names of a mapping in documents."""
    extra = {"unit": unit, "paper": paper} | ({"name": name} if name != "NAME" else {})
    return Field(default, description=meaning, json_schema_extra=extra)


def _as_written(value: Any, handler) -> Any:
    checked = handler(value)
    return value if isinstance(value, int) else checked


def _whole(value: Any) -> Any:
    # 3.0 counts as an integer in JSON, but not as a number of things in Python
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _each_once(value: list) -> list:
    if any(item in value[:number] for number, item in enumerate(value)):
        raise ValueError("contains a value twice")
    return value


def number(**limits: float) -> Any:
    """A finite number within limits (gt, ge, lt, le)."""
    kind = Field(strict=True, allow_inf_nan=False, **limits)
    return Annotated[float, kind, WrapValidator(_as_written)]


def whole(**limits: int) -> Any:
    """A whole number within limits."""
    return Annotated[int, Field(strict=True, **limits), BeforeValidator(_whole)]


def several(kind: Any, **limits: int) -> Any:
    """A list of different values."""
    extra = Field(json_schema_extra={"uniqueItems": True}, **limits)
    return Annotated[list[kind], extra, AfterValidator(_each_once)]


Number = number()
Positive = number(gt=0)
NotNegative = number(ge=0)
Angle = number(ge=0, lt=180)
Count = whole(ge=1, le=1_000_000_000)
Flag = Annotated[bool, Strict()]
Text = Annotated[str, Field(min_length=1)]
Three = Annotated[list[Number], Field(min_length=3, max_length=3)]
ThreePositive = Annotated[list[Positive], Field(min_length=3, max_length=3)]

MOST_STEPS = 10_000_000
"""Most steps of a horizon or a run."""


def is_multiple(value: float, step: float) -> bool:
    """Whether a time is a whole number of steps, at least one."""
    ratio = value / step
    return (
        ratio <= MOST_STEPS
        and math.isclose(ratio, round(ratio), rel_tol=0.0, abs_tol=1e-9)
        and round(ratio) >= 1
    )


def shortened_interval(hours: float, minutes: float) -> str:
    """A warning of a run that ends within a tasking interval; empty if it does not."""
    if is_multiple(60.0 * hours, minutes):
        return ""
    return (
        f"duration_hours = {hours:g} is no multiple of interval_minutes = {minutes:g}, so that the "
        "last tasking interval is shorter than the others"
    )


def require_multiple(key: str, value: float, unit_s: float, step_s: float) -> None:
    """Raise a `ConfigurationError` for a time, in units of `unit_s`, that is no whole number of
    steps."""
    if not is_multiple(unit_s * value, step_s):
        raise ConfigurationError(
            f"{key} = {value} must be a multiple of step_s = {step_s} s, from one to "
            f"{MOST_STEPS:,} steps"
        )
