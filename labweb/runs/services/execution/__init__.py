"""From a queued job to its host: turns of the scheduler, holds, commands, states."""
