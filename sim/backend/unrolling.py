"""Loops whose length is known only when they run are neither unrolled nor interleaved.

LLVM makes eight copies of the body of every such loop, and of its vectorized form, on any processor that it knows (none
on a younger one). In kernels most loops are of this kind, and rows of 30 neighbors gain nothing by the copies: with
them the 85 kernels of a tank in 2D took 27 s to compile and 9 s to load again, without them 14 and 3 s.

And it lets one turn of a vectorized loop take four vectors of eight numbers: of a row of 70 neighbors the last 6 go one
by one, and of a row of 30 all. With one vector in a turn a product of implicit viscosity takes 0.8 times as long. And
vectors have as many numbers as fit of the narrowest kind, not of the widest: candidates for neighbors are looked at by
eights, though their marks are 64 bits wide.

A sum may be added up in another order then, so that its last digit is another one.

Taichi 1.7.4 has no options for this. LLVM has a function that sets its options, but Taichi's library does not export
it, so that it is looked up in the table of symbols that the library comes with.
"""
import ctypes
import functools
import mmap
import struct
import zlib
from pathlib import Path

import numpy as np

from sim.backend.choice import library
from sim.backend.private import core

OPTIONS = (b"-unroll-runtime=0", b"-force-vector-interleave=1", b"-vectorizer-maximize-bandwidth")
SETTER = b"LLVMParseCommandLineOptions"
SYMBOL = np.dtype([("name", "<u4"), ("kind", "u1"), ("visibility", "u1"), ("section", "<u2"), ("value", "<u8"),
                   ("size", "<u8")])
SYMBOL_TABLE = 2  # type of a section (ELF-64 object file format, version 1.5, table 8)


def addresses(path: Path, *names: bytes) -> list[int] | None:
    """Addresses of functions within a library of the format ELF-64, Linux's; None where it does not tell them all.

    path : the library, as it is on the disk.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if content[:6] != b"\x7fELF\x02\x01":
            return None
        (start,), (size, number) = struct.unpack_from("<Q", content, 40), struct.unpack_from("<HH", content, 58)
        sections = [struct.unpack_from("<IIQQQQIIQQ", content, start + size * k) for k in range(number)]
        table = next((one for one in sections if one[1] == SYMBOL_TABLE), None)
        if table is None:
            return None
        words = sections[table[6]]
        places = [content.find(b"\0" + name + b"\0", words[4], words[4] + words[5]) for name in names]
        symbols = np.frombuffer(content[table[4] : table[4] + table[5]], SYMBOL)
        found = [symbols["value"][(symbols["name"] == place + 1 - words[4]) & (symbols["section"] > 0)]
                 for place in places if place >= 0]
    return [int(one[0]) for one in found] if len(found) == len(names) and all(map(len, found)) else None


@functools.cache
def leave_loops_rolled() -> str:
    """Set the options for all that this process compiles from now on; return a word for them, empty if it cannot.

    Where it cannot, as on systems other than Linux, kernels take longer to compile and give the same but for rounding.
    The word is for the name of the folder of compiled kernels: the library does not know of the options, and would take
    up kernels that were compiled with others.
    """
    path = core()
    exported = f"PyInit_{path.name.partition('.')[0]}"
    if not (found := addresses(path, SETTER, exported.encode())):
        return ""
    setter, known = found
    here = ctypes.cast(getattr(ctypes.PyDLL(str(path)), exported), ctypes.c_void_p).value or 0
    words = (ctypes.c_char_p * (1 + len(OPTIONS)))(library().module.encode(), *OPTIONS)
    ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.POINTER(ctypes.c_char_p), ctypes.c_char_p)(here - known + setter)(
        len(words), words, None)
    return f"{zlib.crc32(b' '.join(OPTIONS)):08x}"
