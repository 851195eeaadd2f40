# pyright: reportMissingImports=false
"""Home Assistant itself, run by its own Python: prints each state of an entity as one JSON line.

Arguments: a folder for its files, and the port of the broker."""

import asyncio
import json
import sys
from pathlib import Path

from homeassistant.bootstrap import async_setup_hass
from homeassistant.const import EVENT_STATE_CHANGED
from homeassistant.core import Event, callback
from homeassistant.helpers import device_registry
from homeassistant.runner import RuntimeConfig

CONFIGURATION = """homeassistant: {name: test, unit_system: metric, time_zone: UTC, elevation: 0}
logger: {default: warning}
"""


def write_configuration(folder: Path, port: int) -> None:
    """A configuration.yaml, and the entry of the MQTT integration as its form in the settings writes it."""
    (folder / ".storage").mkdir(parents=True)
    (folder / "configuration.yaml").write_text(CONFIGURATION)
    entry = {
        "entry_id": "1", "version": 1, "minor_version": 1, "domain": "mqtt", "title": "broker", "options": {},
        "data": {"broker": "127.0.0.1", "port": port, "discovery": True, "discovery_prefix": "homeassistant"},
        "pref_disable_new_entities": False, "pref_disable_polling": False, "source": "user", "unique_id": None,
        "disabled_by": None,
    }  # fmt: skip
    stored = {"version": 1, "minor_version": 1, "key": "core.config_entries", "data": {"entries": [entry]}}
    (folder / ".storage" / "core.config_entries").write_text(json.dumps(stored))


async def watch(folder: Path) -> None:
    """Print states until the process is ended."""
    hass = await async_setup_hass(RuntimeConfig(config_dir=str(folder), skip_pip=True))
    if hass is None:
        sys.exit("Home Assistant does not start")

    @callback
    def changed(event: Event) -> None:
        if (state := event.data["new_state"]) is not None:
            print(json.dumps([state.entity_id, state.state, dict(state.attributes)], default=str), flush=True)

    hass.bus.async_listen(EVENT_STATE_CHANGED, changed)
    await hass.async_start()
    print(json.dumps(["ready", "", {}]), flush=True)
    seen: set[str] = set()
    while True:
        for device in device_registry.async_get(hass).devices.values():
            if device.id not in seen:
                seen.add(device.id)
                print(json.dumps(["device", device.name, {"manufacturer": device.manufacturer}]), flush=True)
        await asyncio.sleep(0.2)


if __name__ == "__main__":
    write_configuration(Path(sys.argv[1]), int(sys.argv[2]))
    asyncio.run(watch(Path(sys.argv[1])))
