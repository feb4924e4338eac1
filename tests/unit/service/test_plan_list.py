"""The list of plans: settings as a form needs them, and what keeps a plan from running."""

import pytest

from motord.api.replies import PlanList
from motord.attribute_docs import described
from motord.config import ChannelConfig
from motord.config.experiments import plan_kinds
from motord.experiments.plans import build
from motord.service.rpc.plan_list import plan_form, setting_fields
from tests.unit.service.virtual_service import VirtualService


def listed(service):
    return {plan["name"]: plan for plan in service.ask("plan/list")["plans"]}


def fields(plan):
    return {field["name"]: field for field in plan["fields"]}


@pytest.fixture(scope="module")
def plans():
    return listed(VirtualService())


def test_every_setting_has_a_type_a_line_and_its_default(plans):
    assert plans.keys() == plan_kinds().keys()
    for plan in plans.values():
        own = [field for field in plan["fields"] if field["name"] != "compensate"]
        assert {field["name"]: field["default"] for field in own} == plan["settings"]
        for field in plan["fields"]:
            where = f"{plan['name']} {field['name']}"
            assert field["type"] != "other", where
            assert field["help"].endswith("."), where
            assert len(field["help"]) < 100, where


def test_a_setting_has_unit_and_limits(plans):
    mesh = fields(plans["calibrate"])
    turns, tolerance, torques = mesh["turns"], mesh["speed_tolerance"], mesh["torques_Nm"]
    assert (turns["type"], turns["minimum"], turns["maximum"]) == ("integer", 2, 1000)
    assert turns["help"] == "Turns that are captured at each point."
    assert (tolerance["minimum"], tolerance["minimum_excluded"]) == (0, True)
    assert (tolerance["maximum"], tolerance["maximum_excluded"]) == (0.5, True)
    assert (torques["type"], torques["unit"], torques["minimum"]) == ("list", "Nm", 0)
    assert (torques["length_min"], torques["length_max"]) == (1, 64)
    assert mesh["temperature_C"]["optional"]
    assert (mesh["temperature_C"]["type"], mesh["temperature_C"]["unit"]) == ("list", "degC")
    swing = fields(plans["inertia-oscillation"])
    assert swing["effective_mass"]["choices"] == ["wave", "heavy", "unloaded"]
    assert swing["stator"]["type"] == "boolean"
    assert swing["springs"]["columns"] == ["stiffness_N_per_m", "lever", "mass_kg"]
    gain = fields(plans["sensitivity"])["alpha_a"]
    assert (gain["type"], gain["length_min"], gain["length_max"]) == ("list", 2, 2)


def test_what_is_compensated_is_a_choice_of_what_the_plan_takes(plans):
    choices = {
        name: found["compensate"]["choices"]
        for name, plan in plans.items()
        if "compensate" in (found := fields(plan))
    }
    assert choices["verify"] == ["off", "on", "calibration", "currents", "cogging"]
    assert (choices["friction"], choices["learn"]) == (["off"], ["on"])
    assert choices["sensitivity"] == ["calibration"]
    assert "align" not in choices
    assert fields(plans["calibrate"])["compensate"]["default"] == "off"


def test_what_keeps_a_plan_from_running_is_said():
    service = VirtualService()
    found = listed(service)
    assert (found["calibrate"]["needs"], found["calibrate"]["obstacle"]) == ("brake", "")
    assert "no calibration is installed" in found["verify"]["obstacle"]
    service.bench.calibrated = True
    assert listed(service)["verify"]["obstacle"] == ""
    without = listed(VirtualService(brake={"driver": "none"}))
    assert "needs a brake, and this bench has none" in without["calibrate"]["obstacle"]
    assert without["align"]["obstacle"] == ""


def test_a_plan_that_the_limits_refuse_is_listed_with_the_reason():
    config = VirtualService(limits={"torque_Nm": 2.0}).config
    form = plan_form(config, "calibrate")
    assert "above [limits] torque_Nm" in form.error
    assert form.listed.fields


def test_a_plan_is_started_with_what_its_form_shows(plans):
    channel = {"name": "winding_C", "unit": "degC", "source": {"driver": "simulated"}}
    channels = (ChannelConfig.model_validate(channel),)
    config = VirtualService().config.model_copy(update={"channels": channels})
    for name, plan in plans.items():
        shown = {field["name"]: field["default"] for field in plan["fields"]}
        assert build(name, config, shown).points


def test_settings_of_another_package_may_come_without_its_source(monkeypatch):
    def gone(kind):
        raise OSError

    monkeypatch.setattr("inspect.getsource", gone)
    described.cache_clear()
    section = plan_kinds()["calibrate"].settings
    assert {field.help for field in setting_fields(section)} == {""}
    described.cache_clear()


def test_the_reply_is_encoded_anew_only_where_an_obstacle_changes():
    service = VirtualService()

    def encoded():
        call = service.prepare("plan/list")
        service.dispatcher.handle(call, service.now_ns)
        reply = call.wait(0)
        document = service.available.encode(call.prepared, reply)()
        assert PlanList.model_validate_json(document) == reply
        return document

    first = encoded()
    assert encoded() is first
    service.bench.calibrated = True
    second = encoded()
    assert second != first
    assert encoded() is second
