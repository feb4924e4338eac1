"""The RPC `plan/list`: the plans, their settings, and whether they can run on this bench.

What a form needs of a setting is all in the plan's section of the bench file: bounds in the types,
the line as the string below a field, or its description; the unit is the end of its name.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

from motord.api import requests as rpc
from motord.api.errors import RpcError
from motord.api.replies import AvailablePlan, PlanList, SettingField
from motord.attribute_docs import described
from motord.config import Config
from motord.config.base import Section
from motord.config.experiments import plan_kinds
from motord.config.unit_suffixes import unit_of
from motord.experiments.plans import build as build_plan
from motord.schema import Compensation
from motord.sequencing import Plan, PlanError
from motord.service.bench.bench import Bench
from motord.service.rpc.dispatcher import RpcContext, handles
from motord.service.rpc.outstanding import Document
from motord.service.rpc.preconditions import plan_devices

_TYPES = {
    "number": "number",
    "integer": "integer",
    "boolean": "boolean",
    "string": "text",
    "object": "object",
}


def setting_fields(section: Section) -> list[SettingField]:
    """Return the settings of a section with the values that it has as defaults."""
    schema = type(section).model_json_schema()
    return _fields(type(section), schema, schema.get("$defs", {}), section.model_dump(mode="json"))


def _fields(
    section: type[Section],
    schema: dict[str, Any],
    definitions: dict[str, Any],
    defaults: dict[str, Any],
) -> list[SettingField]:
    lines = described(section)
    return [
        SettingField(
            name=name,
            unit=unit_of(name),
            default=defaults.get(name),
            help=content.get("description", lines.get(name, "")),
            **_type_of(content, definitions),
        )
        for name, content in schema["properties"].items()
    ]


def _type_of(content: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    """Return type, limits and choices of a value by its JSON schema."""
    if "anyOf" in content:
        [some] = [one for one in content["anyOf"] if one.get("type") != "null"]
        return {**_type_of(some, definitions), "optional": True}
    if "enum" in content:
        return {"type": "choice", "choices": list(content["enum"])}
    if content.get("type") == "array":
        return _list_type(content, definitions)
    return {
        "type": _TYPES.get(content.get("type", ""), "other"),
        **_limit(content, "minimum", "exclusiveMinimum"),
        **_limit(content, "maximum", "exclusiveMaximum"),
    }


def _list_type(content: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    one = content["prefixItems"][0] if "prefixItems" in content else content["items"]
    lengths = {"length_min": content.get("minItems", 0), "length_max": content.get("maxItems")}
    if "$ref" in one:
        columns = definitions[one["$ref"].rpartition("/")[2]]["properties"]
        return {"type": "table", "columns": list(columns), **lengths}
    return {**_type_of(one, definitions), "type": "list", **lengths}


def _limit(content: dict[str, Any], included: str, excluded: str) -> dict[str, Any]:
    if excluded in content:
        return {included: content[excluded], f"{included}_excluded": True}
    return {included: content[included]} if included in content else {}


COMPENSATE_HELP = "What of the calibration is applied."


@dataclass(frozen=True)
class PlanForm:
    """A plan as this bench file has it; `plan` is None, and `error` says why, if it cannot be."""

    listed: AvailablePlan
    plan: Plan | None
    error: str


class AvailablePlans:
    """Lists the plans. Making the forms takes a while; it is done once.

    The reply is the longest of all: it is made and encoded anew only when an obstacle changes.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._lock = threading.Lock()
        self._forms: list[PlanForm] = []
        self._listed = PlanList(plans=[])
        self._encoded = self._listed, self._listed.to_json()

    @property
    def made(self) -> bool:
        """Whether the forms are made."""
        return bool(self._forms)

    def prepare(self, payload: bytes) -> tuple[rpc.NoArguments, list[PlanForm]]:
        """Make the forms, unless they are made; for a thread that may wait. Raises RpcError."""
        request = rpc.parse(rpc.PLAN_LIST, payload)
        with self._lock:
            config = self._bench.config
            self._forms = self._forms or [plan_form(config, name) for name in plan_kinds()]
        return request, self._forms

    @handles(rpc.PLAN_LIST)
    def list(self, request: rpc.NoArguments, context: RpcContext) -> PlanList:
        """Return the plans with the settings of this bench, and what keeps one from running."""
        forms: list[PlanForm] = context.prepared
        obstacles = [form.error or self._obstacle(form) for form in forms]
        if obstacles != [plan.obstacle for plan in self._listed.plans]:
            self._listed = PlanList(
                plans=[
                    form.listed.model_copy(update={"obstacle": obstacle})
                    for form, obstacle in zip(forms, obstacles, strict=True)
                ]
            )
        return self._listed

    def encode(self, forms: Sequence[PlanForm], listed: PlanList) -> Document:
        """Return what renders the reply, in the thread that sends it."""

        def rendered() -> bytes:
            last, encoded = self._encoded
            if listed is not last:
                encoded = listed.to_json()
                self._encoded = listed, encoded
            return encoded

        return rendered

    def _obstacle(self, form: PlanForm) -> str:
        try:
            if form.plan is not None:
                plan_devices(self._bench, form.plan)
        except RpcError as error:
            return error.message
        return ""


def plan_form(config: Config, name: str) -> PlanForm:
    """Return the form of a plan with the settings of a bench."""
    section: Section = getattr(config.plans, name.replace("-", "_"))
    plan, error, fields = None, "", setting_fields(section)
    try:
        plan = build_plan(name, config)
    except (PlanError, ImportError, AttributeError) as problem:  # of another package, too
        error = str(problem)
    if plan is not None and "compensate" in plan.settings:
        fields.append(_compensate(config, plan))
    listed = AvailablePlan(
        name=name,
        summary=plan_kinds()[name].summary,
        settings=section.model_dump(mode="json"),
        fields=fields,
        needs=plan.needs if plan is not None else "",
        obstacle="",
    )
    return PlanForm(listed, plan, error)


def _compensate(config: Config, plan: Plan) -> SettingField:
    """Return the setting that a plan knows besides its section, with the values it takes."""

    def taken(value: str) -> bool:
        try:
            build_plan(plan.name, config, {"compensate": value})
        except PlanError:
            return False
        return True

    return SettingField(
        name="compensate",
        type="choice",
        default=plan.settings["compensate"],
        choices=[value for value in get_args(Compensation) if taken(value)],
        help=COMPENSATE_HELP,
    )
