"""Labs to measure in: a small one through the import, grown by plates in the database."""

from __future__ import annotations

import json
from typing import Any
from uuid import UUID

from django.db import connection
from django.db.transaction import atomic

from labweb.crutd import services
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.resources.models import Resource
from labweb.resources.selectors import Lab

PLATE_WELLS = 96
RACK_PLATES = 20
BENCH_RACKS = 10

_GROWN = """
INSERT INTO resources_resource (id, lab_id, parent_id, key, name, kind, nature, config, data,
    extra, rev, is_archived, position)
SELECT md5(kind || n)::uuid, %(lab)s, coalesce(md5(above || (n / each))::uuid, %(root)s),
    kind || n, kind || ' ' || n, kind, 'resource', config, '{}', '{}', 1, false, n
FROM (VALUES
    ('bench', NULL, 1, %(benches)s, '{}'::jsonb),
    ('carrier', 'bench', %(bench_racks)s, %(racks)s, '{}'),
    ('plate', 'carrier', %(rack_plates)s, %(plates)s, '{}'),
    ('well', 'plate', %(plate_wells)s, %(wells)s, '{"capacity_ul": 360}')
) AS sort(kind, above, each, number, config), generate_series(0, number - 1) AS n
ON CONFLICT DO NOTHING
"""
"""Ids are spread at random over the index, as those of an import are. The table has no
trigger on insert, so that none is passed over."""


def a_lab(*, wells: int) -> Lab:
    """Import a lab with one plate of wells in a rack on a bench, the first well full."""
    resources: list[dict[str, Any]] = [
        {"key": "lab", "name": "Lab", "kind": "lab", "parent": None},
        {"key": "table", "name": "Table", "kind": "bench", "parent": "lab"},
        {"key": "shelf", "name": "Shelf", "kind": "bench", "parent": "lab"},
        {"key": "rack", "name": "Rack", "kind": "carrier", "parent": "table"},
        {"key": "plate", "name": "Plate", "kind": "plate", "parent": "rack"},
    ]
    for number in range(1, wells + 1):
        key = f"A{number}"
        well: dict[str, Any] = {"key": key, "name": key, "kind": "well", "parent": "plate"}
        well["config"] = {"capacity_ul": 2_000}
        if number == 1:
            well["contents"] = [{"lot": "water-1", "amount_ul": 1_000}]
        resources.append(well)
    document = {
        "schema": "labweb.lab/1",
        "name": "Measured",
        "time_zone": "UTC",
        "mode": "sim",
        "materials": [{"key": "water", "name": "Water"}],
        "lots": [{"key": "water-1", "material": "water"}],
        "resources": resources,
    }
    lab_file = read_lab(json.dumps(document).encode())
    return services.import_lab(lab_file, actor=None, source={})


@atomic
def grow(lab: Lab, nodes: int) -> dict[str, UUID]:
    """Add benches, racks, plates and wells up to about so many; return ids by key of the first."""
    plates = max(1, nodes // (PLATE_WELLS + 1))
    racks = -(-plates // RACK_PLATES)
    root = Resource.objects.get(lab=lab, parent=None)
    values: dict[str, Any] = {
        "lab": lab.id,
        "root": root.id,
        "benches": -(-racks // BENCH_RACKS),
        "racks": racks,
        "plates": plates,
        "wells": plates * PLATE_WELLS,
        "bench_racks": BENCH_RACKS,
        "rack_plates": RACK_PLATES,
        "plate_wells": PLATE_WELLS,
    }
    with connection.cursor() as cursor:
        cursor.execute(_GROWN, values)
        cursor.execute("ANALYZE resources_resource")
    first = Resource.objects.filter(lab=lab).order_by("position", "key")[:1000]
    return dict(first.values_list("key", "id"))
