"""MAVSDK (C++, its own MAVLink) as the receiver; prints what came, each content once, as JSON lines.

python mavsdk_receiver.py URL SECONDS [DEFINITIONS.xml MESSAGE_ID]: a message that MAVSDK does not know by itself.
"""

import json
import os
import sys
import time
from xml.etree import ElementTree

from mavsdk.component_type import ComponentType  # type: ignore[import-untyped]
from mavsdk.mavsdk import Configuration, Mavsdk  # type: ignore[import-untyped]
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect  # type: ignore[import-untyped]


def definition(path: str, message_id: str) -> str:
    """Return the definitions of one message, without its enumerations."""
    (message,) = (m for m in ElementTree.parse(path).iter("message") if m.get("id") == message_id)
    for field in message.iter("field"):
        field.attrib.pop("enum", None)
    text = ElementTree.tostring(message, encoding="unicode")
    return f'<?xml version="1.0"?><mavlink><version>3</version><messages>{text}</messages></mavlink>'


def main(url: str, seconds: float, *also: str) -> None:
    """Receive for so long, and print."""
    found: dict[str, None] = {}  # ordered, each line once: the messages are sent again and again
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(url)
    print(json.dumps({"name": "READY"}), flush=True)
    end_s = time.monotonic() + seconds
    while not mavsdk.get_systems() and time.monotonic() < end_s:
        time.sleep(0.02)
    if not mavsdk.get_systems():
        return
    direct = MavlinkDirect(mavsdk.get_systems()[0])

    if also:
        direct.load_custom_xml(definition(*also))

    def take(message: object, _: object = None) -> None:
        line = {
            "name": message.message_name,  # type: ignore[attr-defined]
            "source": [message.system_id, message.component_id],  # type: ignore[attr-defined]
            "fields": json.loads(message.fields_json),  # type: ignore[attr-defined]
        }
        found[json.dumps(line)] = None

    direct.subscribe_message("", take, None)
    time.sleep(max(end_s - time.monotonic(), 0.0))
    for line in list(found):
        print(line, flush=True)
    sys.stdout.flush()
    os._exit(0)  # MAVSDK's threads may still call `take`, and would wait for an interpreter that has ended


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), *sys.argv[3:])
