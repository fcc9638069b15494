"""What a driver can be tried on, and what its trials have shown."""

from __future__ import annotations

from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec
from labweb.domain.enrollment.driver_tryout import AnsweredWish, fitting, labelled, tried
from labweb.domain.messages.driver_tryouts import SimulatedModel

SPEC = DriverSpec(
    class_name="Loop",
    module="drivers.processing.lauda_loop",
    digest="0" * 64,
    transport="byte",
    actions=(ActionSpec(name="heat"), ActionSpec(name="hold"), ActionSpec(name="halt")),
)


def a_model(model: str, folder: str = "processing", speaks: str = "byte") -> SimulatedModel:
    return SimulatedModel(
        model=model,
        title=model,
        folder=folder,
        speaks=speaks,
        carriers=["pty"],
        settings={},
        faults={},
    )


def test_models_of_another_class_or_carrier_do_not_fit_and_the_namesake_comes_first() -> None:
    models = [
        a_model("huber_pb"),
        a_model("lauda_loop"),
        a_model("eurotherm", speaks="register"),
        a_model("mettler_sics", folder="sensors"),
    ]
    assert [one.model for one in fitting(SPEC, models)] == ["lauda_loop", "huber_pb"]


def test_an_action_counts_when_it_ended_well_while_no_fault_was_in_force() -> None:
    acts = [
        AnsweredWish(sort="act", name="heat", is_ok=True),
        AnsweredWish(sort="act", name="hold", is_ok=True, has_faults=True),
        AnsweredWish(sort="act", name="halt", is_ok=False, has_faults=True),
        AnsweredWish(sort="act", name="hold", is_ok=False),
        AnsweredWish(sort="fault", name="busy", is_ok=True),
        AnsweredWish(sort="fault", name="stall", is_ok=False),
        AnsweredWish(sort="read", name="", is_ok=True, has_faults=True),
    ]
    found = tried(SPEC, acts)
    assert (found.actions, found.left_out) == (("heat",), ("hold", "halt"))
    assert (found.failed, found.faults) == (("hold",), ("busy",))
    assert not found.statuses_were_read


def test_a_setting_without_a_unit_in_its_name_gets_a_label_and_no_unit() -> None:
    shown = labelled({"type": "object", "properties": {"serial_number": {"type": "string"}}})
    assert shown["properties"] == {"serial_number": {"type": "string", "x-label": "Serial number"}}
