"""Readers of formats that users have: camera files, recorded tracks, road networks, traffic traces.

Recorded input is where a simulation meets the world, and it is seldom clean. Every reader here is pure (a path
in, frozen data out) and every fault is a `DataError` that names the file and line, quotes the value and says
what would be right.

| file | what |
| --- | --- |
| `krtd` | KRTD camera models |
| `tracks` | any track file to `Track` objects: cleaning, splitting, choosing |
| `csv_tracks`, `gpx_tracks`, `eth_tracks`, `fcd_tracks` | one format each |
| `geodesy` | latitude and longitude to local east-north-up metres |
| `sumo` | SUMO road networks, and running the SUMO simulator to make traces |
| `traffic` | proposes operating regions where recorded traffic is densest |

Read `tracks` first.
"""
