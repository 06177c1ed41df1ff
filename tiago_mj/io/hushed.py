"""Import of libraries without what they print on import."""

from __future__ import annotations


def import_gymnasium_robotics() -> None:
    """Import gymnasium-robotics, whose base class ours have, without its notice about environments that are its own.

    Whoever imports it themselves still sees it, and so do those of every other package.
    """
    try:
        from farama_notifications import notifications  # type: ignore[import-untyped]
    except ModuleNotFoundError:
        notifications = {}
    kept = notifications.pop("gymnasium_robotics", None)
    try:
        import gymnasium_robotics  # noqa: F401
    finally:
        if kept is not None:
            notifications["gymnasium_robotics"] = kept
