"""float64 throughout: JAX is set to it when estimable is imported."""

import warnings

import jax

from .errors import EstimableWarning


def enable_float64() -> None:
    """Enable float64 in JAX; warn where float32 arrays were made before, which stay what they are."""
    if jax.config.read("jax_enable_x64"):
        return
    jax.config.update("jax_enable_x64", True)
    if _started() and any(array.dtype == "float32" for array in jax.live_arrays()):
        warnings.warn(
            "estimable works in float64 and has enabled it in JAX, but float32 arrays were made before: "
            "import estimable first, or set JAX_ENABLE_X64=1.",
            EstimableWarning,
            stacklevel=3,
        )


def _started() -> bool:
    """Whether JAX has made a device ready; asking for its arrays would make it so."""
    from jax._src import xla_bridge

    return xla_bridge.backends_are_initialized()


enable_float64()
