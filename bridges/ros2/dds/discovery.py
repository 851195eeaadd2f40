"""Converts the discovery variables of ROS 2 to a configuration of Cyclone DDS.

Source: https://docs.ros.org/en/jazzy/Tutorials/Advanced/Improved-Dynamic-Discovery.html. If none of them is set,
programs on this machine are found and find it whatever their own settings are, and no other machine is contacted (in
ROS 2: the subnet); one whose programs search the subnet finds it nevertheless. LOCALHOST is the loopback interface.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from edgemap.runtime.frames.errors import BridgeError

RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
UNSET = "this machine"


@dataclass(frozen=True, slots=True)
class Discovery:
    """Discovery settings. domain: ROS_DOMAIN_ID. range: one of RANGES, or UNSET. peers: more addresses to contact."""

    domain: int = 0
    range: str = UNSET
    peers: tuple[str, ...] = ()

    def __str__(self) -> str:
        """For people."""
        among = self.range if self.range == UNSET else f"range {self.range}"
        return f"domain {self.domain}, {among}" + "".join(f", {peer}" for peer in self.peers)

    def cyclone_config(self, before: str = "") -> str:
        """Configuration for `cyclonedds.domain.Domain`. before: the user's CYCLONEDDS_URI, which has priority."""
        if self.range == "SYSTEM_DEFAULT":
            return before
        local = self.range == "LOCALHOST" and not self.peers
        interface = '<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>' if local else ""
        # Cyclone's default participants listen to multicast alone, on the network's interface; 0 hops is this machine.
        multicast = "spdp" if self.range in ("SUBNET", UNSET) else "false"
        hops = "<MulticastTimeToLive>0</MulticastTimeToLive>" if self.range == UNSET else ""
        peers = (*self.peers, *(("localhost",) if self.range != "OFF" else ()))
        listed = "".join(f'<Peer address="{peer}"/>' for peer in peers)
        general = f"{interface}<AllowMulticast>{multicast}</AllowMulticast>{hops}"
        # Participants of one machine are found by port, at most 32; they are looked for every second, as older ROS 2
        # versions announce themselves by multicast only, which the loopback interface lacks.
        discovery = (
            "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
            f"<SPDPInterval>1s</SPDPInterval><Peers>{listed}</Peers>"
        )
        ours = (
            f"<CycloneDDS><Domain><General>{general}</General><Discovery>{discovery}</Discovery></Domain></CycloneDDS>"
        )
        return ",".join(filter(None, (ours, before)))


def discovery_from(environment: Mapping[str, str]) -> Discovery:
    """Of ROS_DOMAIN_ID, ROS_LOCALHOST_ONLY, ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS. Raises BridgeError."""
    text = environment.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not text.isdecimal() or int(text) > 232:  # higher domains would need ports above the maximum
        raise BridgeError(f"ROS_DOMAIN_ID={text}: a whole number from 0 to 232")
    local = environment.get("ROS_LOCALHOST_ONLY", "").strip()
    asked = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").strip().upper()
    if asked and asked not in RANGES:
        raise BridgeError(f"ROS_AUTOMATIC_DISCOVERY_RANGE={asked}: one of {', '.join(RANGES)}")
    peers = tuple(peer.strip() for peer in environment.get("ROS_STATIC_PEERS", "").split(";") if peer.strip())
    if bad := [peer for peer in peers if set(peer) & set("<>&\"' ")]:
        raise BridgeError(f"ROS_STATIC_PEERS: {bad[0]!r} is no address")
    if local == "1":
        return Discovery(int(text), "LOCALHOST")
    if local == "0" and not asked:
        asked = "SUBNET"
    return Discovery(int(text), asked or UNSET, peers)
