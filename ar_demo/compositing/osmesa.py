"""An OpenGL context without window, display server or GPU: libOSMesa for `moderngl.create_context(context=)`."""

import ctypes
from typing import Self

from ..errors import RunError

LIBRARY = "libOSMesa.so.8"

# Names and values from <GL/osmesa.h> and <GL/gl.h>.
OSMESA_FORMAT = 0x22
OSMESA_DEPTH_BITS = 0x30
OSMESA_PROFILE = 0x33
OSMESA_CORE_PROFILE = 0x34
OSMESA_CONTEXT_MAJOR_VERSION = 0x36
OSMESA_CONTEXT_MINOR_VERSION = 0x37
GL_RGBA = 0x1908
GL_UNSIGNED_BYTE = 0x1401


class OSMesaContext:
    """A core profile 3.3 context, current from the start; entering it makes it current on the calling thread again.

    Raises:
        RunError: the library is missing, or cannot make such a context.
    """

    def __init__(self) -> None:
        try:
            self._library = ctypes.CDLL(LIBRARY)
        except OSError as error:
            raise RunError(f"{LIBRARY} cannot be loaded ({error}): install libosmesa6") from error
        create, make_current = self._library.OSMesaCreateContextAttribs, self._library.OSMesaMakeCurrent
        create.argtypes, create.restype = (ctypes.POINTER(ctypes.c_int), ctypes.c_void_p), ctypes.c_void_p
        make_current.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_int)
        make_current.restype = ctypes.c_ubyte
        self._library.OSMesaDestroyContext.argtypes = (ctypes.c_void_p,)
        self._library.OSMesaDestroyContext.restype = None
        self._library.OSMesaGetProcAddress.argtypes = (ctypes.c_char_p,)
        self._library.OSMesaGetProcAddress.restype = ctypes.c_void_p

        wanted = (
            *(OSMESA_FORMAT, GL_RGBA, OSMESA_DEPTH_BITS, 0, OSMESA_PROFILE, OSMESA_CORE_PROFILE),
            *(OSMESA_CONTEXT_MAJOR_VERSION, 3, OSMESA_CONTEXT_MINOR_VERSION, 3, 0),
        )
        self._screen = ctypes.create_string_buffer(4)  # the window that OSMesa must have, one pixel, never drawn to
        self._context: int | None = create((ctypes.c_int * len(wanted))(*wanted), None)
        if not self._context:
            raise RunError("OSMesa cannot make an OpenGL 3.3 core context: install a newer libosmesa6")
        self.__enter__()

    def load_opengl_function(self, name: str) -> int:
        """Address of an OpenGL function, 0 if there is none."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    load = load_opengl_function

    def __enter__(self) -> Self:
        if not self._library.OSMesaMakeCurrent(self._context, self._screen, GL_UNSIGNED_BYTE, 1, 1):
            raise RunError("OSMesa cannot make its context current")
        return self

    def __exit__(self, *error: object) -> None:
        """Stay current: whoever draws next enters their own context. moderngl passes no arguments here."""

    def release(self) -> None:
        """Free the context; calling again does nothing."""
        if self._context:
            self._library.OSMesaMakeCurrent(None, None, GL_UNSIGNED_BYTE, 0, 0)
            self._library.OSMesaDestroyContext(self._context)
            self._context = None
