"""Address of a view in the browser: it holds the layout, and opening it gives the layout back.

viser has no message from a browser to the server but those of its controls. The query of the address, and whether the
browser prefers a dark page, therefore come through a text field that is not seen.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from typing import Any, Final
from urllib.parse import parse_qs

import numpy as np

from tiago_mj.view import layout
from tiago_mj.view.server import PHONE, in_browser, theme

#: The address follows the layout so many times a second.
ADDRESS_HZ: Final = 2.0
#: Label of the field, by which the script finds it.
FIELD: Final = "address of this view"
#: Script for a browser: it reports its address, writes the layout into it, and notes whether the panel is folded.
SCRIPT: Final = """(() => {
  if (window.tiagoReport) return window.tiagoReport(location.search.slice(1));
  const known = new Set(%(keys)s), phone = innerWidth < %(phone)d;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  let layout = null;
  const label = () => [...document.querySelectorAll("label")].find((one) => one.textContent === %(field)s);
  function input() {
    let row = label();
    while (row && !row.querySelector("input")) row = row.parentElement;
    if (!row) return null;
    row.parentElement.style.cssText = "height:0;padding:0;overflow:hidden";
    const found = row.querySelector("input");
    found.tabIndex = -1;
    return found;
  }
  window.tiagoReport = (query, left = 100) => {
    const field = input();
    if (!field) return left && setTimeout(() => window.tiagoReport(query, left - 1), 100);
    const text = `dark=${dark.matches ? 1 : 0}&${query}`;
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(field, text);
    field.dispatchEvent(new Event("input", { bubbles: true }));
  };
  function write() {
    input();
    if (layout === null || window.tiagoFolding) return;
    const parts = location.search.slice(1).split("&").filter((one) => one && !known.has(one.split("=")[0]));
    if (layout) parts.push(layout);
    const seen = label(), folded = !seen || !seen.checkVisibility();
    if (folded !== phone) parts.push(folded ? "panel=folded" : "panel=open");
    const query = parts.length ? `?${parts.join("&")}` : "";
    if (query !== location.search) history.replaceState(null, "", location.pathname + query);
  }
  window.tiagoAddress = (text) => { layout = text; write(); };
  window.tiagoReport(location.search.slice(1));
  setInterval(write, 500);
  dark.addEventListener("change", () => window.tiagoReport(""));
})();"""


class Address:
    """Layout of a view in the addresses of the browsers that show it.

    Args:
        server: a ``viser.ViserServer``.
        state: the layout as it is, without the camera.
        apply: gives what an address says; parts that it lacks, or that do not fit, stay as they are.
    """

    def __init__(
        self, server: Any, state: Callable[[], Mapping[str, str]], apply: Callable[[Mapping[str, str]], None]
    ) -> None:
        self._server, self._state, self._apply = server, state, apply
        self._written: dict[int, str] = {}
        self._last = 0.0
        self._field = server.gui.add_text(FIELD, "")
        self._field.on_update(lambda event: self._told(event.client))
        known = json.dumps([*layout.KEYS, layout.PANEL])
        script = SCRIPT % {"keys": known, "phone": PHONE, "field": json.dumps(FIELD)}
        server.on_client_connect(lambda client: in_browser(client, script))
        server.on_client_disconnect(lambda client: self._written.pop(client.client_id, None))

    def tick(self) -> None:
        """Write the layout where it has changed since it was last written."""
        now = time.monotonic()
        if now - self._last < 1 / ADDRESS_HZ:
            return
        self._last = now
        state: Mapping[str, str] | None = None
        for number, client in self._server.get_clients().items():
            if number not in self._written:  # it has not said yet what its address asks for
                continue
            state = self._state() if state is None else state
            text = layout.write({**state, "camera": self._camera(client)})
            if text != self._written[number]:
                self._written[number] = text
                in_browser(client, f"window.tiagoAddress && window.tiagoAddress({json.dumps(text)})")

    def _told(self, client: Any) -> None:
        """Follow the report of a browser, once; ``client`` is None where the field was set here."""
        text = str(self._field.value)
        if client is None or not text:
            return
        self._field.value = ""  # so that the same report is told again when the page is loaded anew
        theme(client.gui, dark=parse_qs(text[:100]).get("dark") == ["1"])
        parts = layout.read(text)
        place = layout.numbers(parts.get("camera", ""), 6)
        if place is not None and not np.allclose(place[:3], place[3:]):
            client.camera.position = place[:3]
            client.camera.look_at = place[3:]
        if parts.get(layout.PANEL) == "folded":
            client.gui.main_panel.minimize()
        self._apply(parts)
        self._written.setdefault(client.client_id, "")

    def _camera(self, client: Any) -> str:
        """Where the camera of a browser is and what it looks at; empty where it is as at the start."""
        camera, first = client.camera, self._server.initial_camera
        at = np.concatenate([camera.position, camera.look_at])
        if np.allclose(at, np.concatenate([first.position, first.look_at]), atol=1e-3):
            return ""
        return layout.rounded([round(float(value), 4) + 0.0 for value in at])
