"""Paths over junctions that are one point: SUMO writes them where two streets touch."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.errors import DataError
from camnet.experiments.road_site import read_road_site

pytest.importorskip("sumolib")

NET = """<net version="1.20">
<edge id=":b_0" function="internal">
<lane id=":b_0_0" index="0" speed="9" length="0.1" shape="100.00,0.00 100.00,0.00"/></edge>
<edge id="in" from="a" to="b"><lane id="in_0" index="0" speed="14" length="100" shape="0.00,0.00 100.00,0.00"/></edge>
<edge id="out" from="b" to="c"><lane id="out_0" index="0" speed="14" length="100" shape="{out}"/></edge>
<junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0.00,0.00"/>
<junction id="b" type="priority" x="100" y="0" incLanes="in_0" intLanes=":b_0_0" shape="100.00,0.00"/>
<junction id="c" type="dead_end" x="200" y="0" incLanes="out_0" intLanes="" shape="200.00,0.00"/>
<connection from="in" to="out" fromLane="0" toLane="0" via=":b_0_0" dir="s" state="M"/>
<connection from=":b_0" to="out" fromLane="0" toLane="0" dir="s" state="M"/>
</net>"""


def test_streets_that_touch_follow_each_other(tmp_path):
    path = tmp_path / "touch.net.xml"
    path.write_text(NET.format(out="100.00,0.00 200.00,0.00"))
    site = read_road_site(path)
    np.testing.assert_allclose(site.roads.length_m, [100.0, 100.0])
    assert site.roads.successor.tolist() == [1]


def test_a_street_of_one_point_is_refused(tmp_path):
    path = tmp_path / "point.net.xml"
    path.write_text(NET.format(out="100.00,0.00 100.00,0.00"))
    with pytest.raises(DataError, match=r"lane 'out_0'.*two different points were expected"):
        read_road_site(path)
