"""How functions are compiled, and where the machine code is kept.

| read | for |
| --- | --- |
| `kernel` | ``cached_njit``, the one decorator of functions whose machine code is kept |
| `store` | one file for each compiled function and kind of arguments; safe for many processes and installations |
| `source` | what a compiled function is made of: the digest that its file is found by |

No other module may use Numba's own cache: it needs a writable folder beside the source or a home, and it notices
changes in the function's own file alone.
"""

from camnet.compiled.kernel import announce, cached_njit, kernels

__all__ = ["announce", "cached_njit", "kernels"]
