"""What a setting is made of: types that keep their range, and a field with unit and meaning.

A number stays as it was written, 60 or 60.0, since settings are kept with the results.
"""

import datetime
from functools import cache
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    WithJsonSchema,
    WrapValidator,
    create_model,
    model_serializer,
)

from cislunar.ephemeris.time_scales import julian_date


class Section(BaseModel):
    """A part of the configuration; no other keys than its fields are allowed."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _without_defaults(schema: dict[str, Any]) -> None:
    for each in schema["properties"].values():
        each.pop("default", None)


class Partial(Section):
    """A section of which any key may be left out; it holds those that are given."""

    model_config = ConfigDict(json_schema_extra=_without_defaults)

    @model_serializer(mode="wrap")
    def _given(self, handler) -> dict[str, Any] | None:
        if self is None:  # a key left out, whose default stands for nothing
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
    meaning: str, unit: str = "", paper: str = "", *, default: Any = ..., name: str = "NAME"
) -> Any:
    """A key: its meaning, unit, the paper's value, and a default where config.yaml need not say.

    Without a default it has to be given. `name` stands for the names of a mapping in documents.
    """
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
        raise ValueError("holds a value twice")
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


FIRST_JD = 2_441_317.5
"""1972-01-01, when UTC with leap seconds begins."""


def _julian(value: Any) -> Any:
    # YAML makes a date of one that is not quoted
    if isinstance(value, datetime.datetime) and value.tzinfo:
        value = value.astimezone(datetime.UTC).replace(tzinfo=None)
    text = value.isoformat() if isinstance(value, datetime.date) else value
    found = julian_date(text) if isinstance(text, str) else text
    if isinstance(found, bool) or not isinstance(found, int | float) or not found >= FIRST_JD:
        raise ValueError(
            f"must be a Julian date, at least {FIRST_JD:,}, or a date like 2024-10-01T00:00:00"
        )
    return found


Number = number()
Date = Annotated[
    number(),
    BeforeValidator(_julian),
    WithJsonSchema({"type": ["number", "string"], "minimum": FIRST_JD}),
]
"""A Julian date, which may be written in ISO 8601."""
Positive = number(gt=0)
NotNegative = number(ge=0)
Angle = number(ge=0, lt=180)
Count = whole(ge=1, le=1_000_000_000)
Starts = whole(ge=0, le=1_000_000_000)
Flag = Annotated[bool, Strict()]
Text = Annotated[str, Field(min_length=1)]
Three = Annotated[list[Number], Field(min_length=3, max_length=3)]
ThreePositive = Annotated[list[Positive], Field(min_length=3, max_length=3)]
