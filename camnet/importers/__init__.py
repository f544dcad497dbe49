"""Readers of formats that users have: KRTD cameras, GPX/CSV/ETH tracks, SUMO roads and traces."""
