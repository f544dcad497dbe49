"""How targets move: vector fields, unicycles, roads, recorded tracks. Pure; generators are passed in."""
