"""A computer elsewhere that carries out prepared jobs: a cluster, a workstation."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Compute(ABC):
    """Runs the jobs that its settings hold, one at a time, and moves no matter."""

    @abstractmethod
    def run_job(self, job: str, input_text: str, limit_s: float) -> Report:
        """Submit a prepared job and wait for its end; evidence `job_state`, `exit_code_index`.

        Effect:
            None on matter.
        """

    @abstractmethod
    def cancel_job(self) -> Report:
        """End the job of this driver, and return once it has ended.

        Effect:
            None on matter.
        """

    @abstractmethod
    def is_available(self) -> bool:
        """Tell whether jobs are taken."""

    @abstractmethod
    def is_running(self) -> bool:
        """Tell whether a job of this driver has not ended."""

    @abstractmethod
    def job_state(self) -> str:
        """Tell the state of the last job of this driver; `none`: there was none."""
