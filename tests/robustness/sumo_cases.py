"""Road networks, and the tables of cameras over them."""

from __future__ import annotations

import copy
from collections.abc import Callable
from random import Random
from typing import Any

from robustness import inputs
from robustness.case import Case, Nature, changed
from robustness.formats import write_network
from robustness.stage import COMMANDS
from robustness.text import bad_number, broken_text, misspelt, same_number

__all__ = ["BROKEN", "HARMLESS", "MEANING"]

_LOCATION = (
    '<location netOffset="0.00,0.00" convBoundary="0.00,0.00,100.00,100.00" origBoundary="0.00,0.00,100.00,100.00" '
    'projParameter="!"/>'
)
_NET, _TABLE = "city.net.xml", "city.csv"
_COMMAND = COMMANDS["certify city"]
_Net = dict[str, Any]


def _case(label: str, content: str, *mentions: str, file: str = _NET) -> Case:
    return changed("sumo", label, Nature.MEANING, _COMMAND, file, content, *(mentions or (file,)))


def _number(rng: Random) -> Case:
    net, (label, bad) = inputs.network(), bad_number(rng, "")
    where = rng.choice(("shape", "length", "speed", "junction"))
    edge = rng.choice(net["edges"])
    lane = edge["lanes"][0]
    if where == "shape":
        first, second = lane["shape"].split(" ")
        lane["shape"] = f"{first.split(',')[0]},{bad} {second}" if bad.strip() else f",{bad} {second}"
    elif where == "junction":
        rng.choice(net["junctions"])[rng.choice("xy")] = bad
    else:
        lane[where] = bad
    return _case(f"number of {where}: {label}", write_network(net))


def _edge_twice(rng: Random, net: _Net) -> None:
    net["edges"].append(copy.deepcopy(rng.choice(net["edges"])))


def _lane_twice(rng: Random, net: _Net) -> None:
    one, two = rng.sample(net["edges"], 2)
    one["lanes"][0]["id"] = two["lanes"][0]["id"]


def _junction_twice(rng: Random, net: _Net) -> None:
    one, two = rng.sample(net["junctions"], 2)
    one["id"] = two["id"]


def _no_lane(rng: Random, net: _Net) -> None:
    rng.choice(net["edges"])["lanes"] = []


def _no_length(rng: Random, net: _Net) -> None:
    lane = rng.choice(net["edges"])["lanes"][0]
    point = lane["shape"].split(" ")[0]
    if rng.random() < 0.5:
        lane["shape"] = f"{point} {point}"
    else:
        lane["length"] = rng.choice(("0", "0.00", "-100"))


def _attribute_lost(rng: Random, net: _Net) -> None:
    holder, name = rng.choice(
        [(rng.choice(net["edges"]), key) for key in ("id", "from", "to")]
        + [(rng.choice(net["edges"])["lanes"][0], key) for key in ("id", "shape", "length", "speed")]
        + [(rng.choice(net["junctions"]), key) for key in ("id", "x", "y")]
        + [(rng.choice(net["connections"]), key) for key in ("from", "to")]
    )
    if rng.random() < 0.5:
        holder[misspelt(rng, name + "s" if len(name) < 2 else name, set(holder))] = holder[name]
    del holder[name]


def _unknown_junction(rng: Random, net: _Net) -> None:
    rng.choice(net["edges"])[rng.choice(("from", "to"))] = rng.choice(("z", "", "ab", "A"))


def _unknown_edge(rng: Random, net: _Net) -> None:
    rng.choice(net["connections"])[rng.choice(("from", "to"))] = rng.choice(("zz", "", "ab_0", "AB"))


def _shape_in_centimetres(rng: Random, net: _Net) -> None:
    lane = rng.choice(net["edges"])["lanes"][0]
    factor = rng.choice((100.0, 1000.0, 0.001))
    points = [[float(x) for x in point.split(",")] for point in lane["shape"].split(" ")]
    lane["shape"] = " ".join(",".join(f"{factor * x + 1.0}" for x in point) for point in points)
    if factor < 1.0:
        lane["length"] = "100000.0"


def _one_point(rng: Random, net: _Net) -> None:
    lane = rng.choice(net["edges"])["lanes"][0]
    lane["shape"] = rng.choice(
        (lane["shape"].split(" ")[0], "", " ", lane["shape"].replace(",", ";"), "1 2 3 4")
    )


def _off_the_earth(rng: Random, net: _Net) -> None:
    junction = rng.choice(net["junctions"])
    junction[rng.choice("xy")] = str(rng.choice((-1, 1)) * 10.0 ** rng.uniform(8, 300))


def _no_street(rng: Random, net: _Net) -> None:
    if rng.random() < 0.5:
        net["edges"], net["connections"] = [], []
    else:
        for edge in net["edges"]:
            edge["function"] = rng.choice(("internal", "walkingarea"))


def _not_for_cars(rng: Random, net: _Net) -> None:
    for edge in net["edges"]:
        edge["lanes"][0]["allow"] = rng.choice(("bicycle", "pedestrian", "rail"))


_CHANGES: dict[str, Callable[[Random, _Net], None]] = {
    "edge twice": _edge_twice,
    "lane twice": _lane_twice,
    "junction twice": _junction_twice,
    "edge without a lane": _no_lane,
    "lane without a length": _no_length,
    "attribute lost": _attribute_lost,
    "unknown junction": _unknown_junction,
    "unknown edge": _unknown_edge,
    "shape in another unit": _shape_in_centimetres,
    "shape of one point": _one_point,
    "off the Earth": _off_the_earth,
    "no street": _no_street,
    "no street for cars": _not_for_cars,
}


def _meaning(label: str, change: Callable[[Random, _Net], None]) -> Callable[[Random], Case]:
    def make(rng: Random) -> Case:
        net = inputs.network()
        change(rng, net)
        return _case(label, write_network(net))

    return make


def _table_number(rng: Random) -> Case:
    label, bad = bad_number(rng)
    quoted = f'"{bad}"' if "," in bad else bad
    text = inputs.CAMERAS.replace(rng.choice((",50,", ",52.5,")), f",{quoted},", 1)
    return _case(f"table: number: {label}", text, "line", file=_TABLE)


def _table(rng: Random) -> Case:
    text = inputs.CAMERAS
    ways = {
        "name twice": text.replace("north", "south"),
        "name empty": text.replace("north", rng.choice(("", " "))),
        "column lost": text.replace("name,x,y", "name,x,z"),
        "column twice": text.replace("name,x,y", "name,x,x"),
        "column misspelt": "name,x,y,footprnt\na,50,0,20\nb,52.5,100,20\n",
        "footprint negative": f"name,x,y,footprint\na,50,0,{-rng.uniform(0.1, 50)}\n",
        "footprint zero": "name,x,y,footprint\na,50,0,0\n",
        "cost negative": f"name,x,y,cost\na,50,0,{-rng.uniform(0.1, 50)}\n",
        "field lost": text.replace(",100", ""),
        "field more": text.replace(",100", ",100,3"),
        "no header": text.partition("\n")[2],
        "no row": text.partition("\n")[0] + "\n",
        "sizes differ": "name,x,y,footprint\na,50,0,20\nb,52.5,100,30\n",
    }
    label = rng.choice(sorted(ways))
    return _case(f"table: {label}", ways[label], _TABLE, "footprints", file=_TABLE)


_WORDS = ("--footprint=0", "--footprint=-3", "--footprint=nan", "--v-max=0", "--v-max=1e999", "--extent=1_0", "--off-max=-5",
          "--on-min=\u0663", "--model-error=inf", "--range=0x10")  # fmt: skip


def _words(rng: Random) -> Case:
    return Case("sumo", "words of the command line", Nature.MEANING, _COMMAND, {}, (rng.choice(_WORDS),))


MEANING = [_meaning(label, change) for label, change in _CHANGES.items()]
MEANING += [_number, _number, _number, _table_number, _table, _table, _words]


def _broken(rng: Random) -> Case:
    text = write_network(inputs.network())
    bomb = "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 10}">' for k in range(9))
    ways = {
        "entities": f'<!DOCTYPE net [<!ENTITY e0 "aaaaaaaaaa">{bomb}]>{text.replace("<edge ", "<x>&e9;</x><edge ", 1)}',
        "outside entity": f'<!DOCTYPE net [<!ENTITY x SYSTEM "file:///dev/zero">]>{text.replace("<edge ", "&x;<edge ", 1)}',
        "deep": text.replace("<edge ", "<x>" * 3000 + "</x>" * 3000 + "<edge ", 1),
        "tag": text.replace("</edge>", "", 1),
        "attribute twice": text.replace("<edge ", '<edge id="q" ', 1),
        "another format": text.replace("<net", "<network").replace("</net", "</network"),
        "quote": text.replace('"', "", 1),
    }
    label = rng.choice([*ways, "text", "text"])
    if label == "text":
        label, content = broken_text(rng, text, 0.0, 0.9)
        if label == "UTF-16":
            content = text.encode("utf-32-le")
        return changed("sumo", label, Nature.BROKEN, _COMMAND, _NET, content, _NET)
    return changed("sumo", label, Nature.BROKEN, _COMMAND, _NET, ways[label], _NET)


def _rewritten(rng: Random) -> Case:
    net = inputs.network()
    for edge in net["edges"]:
        for part in (edge, *edge["lanes"]):
            items = list(part.items())
            rng.shuffle(items)
            part.clear()
            part.update(items)
        lane = edge["lanes"][0]
        if rng.random() < 0.3:
            lane["length"], lane["speed"] = (
                same_number(rng, float(lane["length"])),
                same_number(rng, float(lane["speed"])),
            )
        if rng.random() < 0.3:
            edge |= {"name": rng.choice(("Hauptstra\u00dfe", "<b>", "a & b")), "shape": lane["shape"]}
    rng.shuffle(net["connections"])
    head = rng.choice(("", "<!-- made by hand -->", _LOCATION, '<type id="x" priority="1"/>'))
    text = write_network(net, head, rng.choice(("\n", "\r\n", "\n\n    ", "")))
    return changed("sumo", "rewritten", Nature.HARMLESS, _COMMAND, _NET, text)


def _table_rewritten(rng: Random) -> Case:
    rows = [
        ["south", same_number(rng, 50.0), same_number(rng, 0.0)],
        ["north", "52.5", same_number(rng, 100.0)],
    ]
    head = ["name", "x", "y"]
    if rng.random() < 0.5:
        head, rows = [*head, "comment"], [[*row, "ok"] for row in rows]
    if rng.random() < 0.5:
        order = rng.sample(range(len(head)), len(head))
        head, rows = [head[k] for k in order], [[row[k] for k in order] for row in rows]
    text = "\n".join(",".join(row) for row in [head, *rows]) + rng.choice(("\n", "", "\n\n"))
    if rng.random() < 0.4:
        text = text.replace("\n", "\r\n")
    return changed("sumo", "table rewritten", Nature.HARMLESS, _COMMAND, _TABLE, text)


BROKEN = [_broken]
HARMLESS = [_rewritten, _rewritten, _table_rewritten]
