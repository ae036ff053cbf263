"""What the library raises where a kernel is wrong."""
from sim.backend.choice import library
from sim.backend.private import exception

CompilationError = getattr(exception, f"{library().word}CompilationError")
KernelSyntaxError = getattr(exception, f"{library().word}SyntaxError")
KernelTypeError = getattr(exception, f"{library().word}RuntimeTypeError")
