"""Every published SiLA 2 feature, and what the browser makes of it: nothing is left out unsaid."""

from __future__ import annotations

import pytest

from drivers.browse.sila import describe_feature
from drivers.transports.sila.features import parse_feature
from labweb.domain.enrollment.driver_spec import encode, parse
from tests.corpus import INSTRUMENTS, NO_INSTRUMENTS

FEATURES = INSTRUMENTS / "sila2"

MADE = {
    "InitializationController": (0, 1, 0),
    "ProgramController": (0, 2, 1),
    "SingleConnectionController": (1, 2, 0),
    "StateService": (1, 1, 0),
    "WarpdriveService": (0, 1, 2),
    "DeviceInformationProvider": (4, 0, 0),
    "MessagingController": (0, 1, 0),
    "StorageService": (0, 0, 7),
    "AuthenticationService": (0, 1, 1),
    "AuthorizationConfigurationService": (1, 1, 0),
    "AuthorizationProviderService": (0, 1, 0),
    "AuthorizationService": (0, 0, 0),
    "LockController": (1, 2, 0),
    "SiLAService": (6, 2, 1),
    "SimulationController": (1, 2, 0),
    "CancelController": (0, 1, 1),
    "ParameterConstraintsProvider": (0, 0, 1),
    "PauseController": (1, 0, 2),
    "GreetingProvider": (0, 1, 1),
    "TemperatureController": (1, 1, 0),
    "CoverController": (0, 2, 0),
    "ComplexDataTypeTest": (2, 1, 14),
    "DataTypeProvider": (2, 3, 23),
    "ObservableCommandTest": (0, 0, 3),
    "ObservablePropertyTest": (0, 0, 1),
}
"""Statuses, actions and findings of each. A finding is a list, a structure or a type that the
feature names itself (no plain value), or a number without a unit or in one that we do not have.
"""

pytestmark = pytest.mark.skipif(not FEATURES.exists(), reason=NO_INSTRUMENTS)


def definitions() -> dict[str, str]:
    texts = [path.read_text("utf-8") for path in sorted(FEATURES.rglob("*.sila.xml"))]
    return {parse_feature(text).name: text for text in texts}


def test_every_published_feature_is_read() -> None:
    assert set(definitions()) == set(MADE)


@pytest.mark.parametrize("name", MADE)
def test_each_command_and_property_is_offered_or_said_why_not(name: str) -> None:
    feature = parse_feature(definitions()[name])
    found = describe_feature(feature, doc="A server.")
    spec = found.spec
    assert parse(encode(spec)) == spec
    assert (len(spec.statuses), len(spec.actions), len(spec.findings)) == MADE[name]
    assert {finding.code for finding in spec.findings} <= {"browse.type", "browse.unit"}
    offered = {binding.node for binding in found.bindings.values()}
    assert len(offered) == len(spec.statuses) + len(spec.actions)
    refused = {"/".join(finding.subject.split("/")[:5]) for finding in spec.findings}
    assert offered.isdisjoint(refused)
    assert offered | refused == {
        f"{feature.id}/{one}" for one in (*feature.commands, *feature.properties)
    }
