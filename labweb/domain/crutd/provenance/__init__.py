"""Where things came from and what became of them: matter, acts, people, devices, code.

`flows` and `lineage` follow matter through the ledger; `graph` holds entities, activities and
agents; `build` makes it from what is on record; `prov_json` and `prov_read` are its PROV form.
"""

from __future__ import annotations

from labweb.domain.crutd.provenance.flows import Flow, is_nominal

__all__ = ["Flow", "is_nominal"]
