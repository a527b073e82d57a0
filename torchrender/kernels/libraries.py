"""Machine code for what is called from Python alone: everything below it stays LLVM's intermediate code.

Numba optimises every helper for itself and makes machine code of it, and does so again in each of its callers, which
it is linked into; the body of a parallel loop goes through this four times. Here helpers and the parts of parallel
loops are only linked, and optimised once, in the function that Python calls. (The idea is that of numba's pull request
9566.) Compilers change inside, so this is for the versions that it was tested with; others, or
``TORCHRENDER_PLAIN_COMPILER=1``, compile as numba does.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import llvmlite
import llvmlite.binding
import numba
from numba.core import compiler, typed_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import register_pass
from numba.core.environment import lookup_environment
from numba.core.targetconfig import ConfigStack
from numba.core.typing import templates
from numba.parfors.parfor_lowering import ParforLower

TESTED = {("0.68.1", "0.50.0")}
"""Versions of numba and llvmlite."""
PLAIN = "TORCHRENDER_PLAIN_COMPILER"
KIND = "torchrender-helper"
OWN_CODE: set[Any] = set()
"""Python functions that get machine code although Python never calls it."""
_LOOP_PARTS = ("__numba_parfor_gufunc", "parallelgufuncwrapper", "<numba.np.ufunc.wrappers._GufuncWrapper")


def is_used() -> bool:
    """Whether helpers are linked only."""
    return (numba.__version__, llvmlite.__version__) in TESTED and not os.environ.get(PLAIN)


class _NoEngine:
    """The code generator of a helper: what it makes has no address, so nothing can be set in it."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, environment: Any) -> None:
        """The functions that it is linked into do it."""


class _Library(JITCodeLibrary):
    """What both kinds have in common."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Those that have code; numba sets all passes up for each declaration, too, where LLVM does nothing."""
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                manager, builder = self._codegen._function_pass_manager()
                manager.run(function, builder)


class HelperLibrary(_Library):
    """Code to be linked into others."""

    @property
    def codegen(self) -> Any:
        """As lowering asks for it."""
        return _NoEngine(self._codegen)

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002
        """There is no machine code; all helpers get their pointers from who links them."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Its intermediate code."""
        self._ensure_finalized()
        return self.name, KIND, self._final_module.as_bitcode()

    def add_ir_module(self, ir_module: Any) -> None:
        """Without wrappers for Python, which bodies of parallel loops get, too."""
        if ir_module.name != "wrapper":
            super().add_ir_module(ir_module)

    @classmethod
    def restored(cls, codegen: Any, name: str, code: bytes) -> HelperLibrary:
        """From its intermediate code."""
        made = cls(codegen, name)
        made._final_module = llvmlite.binding.parse_bitcode(code)
        made._finalize_final_module()
        return made

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


class RootLibrary(_Library):
    """Machine code of a function that Python calls, with its helpers."""

    def _finalize_final_module(self) -> None:
        super()._finalize_final_module()
        engine = self._codegen._engine
        for variable in self._final_module.global_variables:
            if variable.name.startswith("_ZN08NumbaEnv") and engine.is_symbol_defined(variable.name):
                environment = lookup_environment(variable.name)
                if environment is not None:
                    self._codegen.set_env(variable.name, environment)


@contextmanager
def _loops_as_helpers(codegen: Any) -> Iterator[None]:
    """In here the parts of parallel loops are made as helpers. Compilation holds numba's lock."""
    plain = type(codegen).create_library

    def create(name: str, **rest: Any) -> Any:
        if name.startswith(_LOOP_PARTS):
            return HelperLibrary(codegen, name, **rest)
        return plain(codegen, name, **rest)

    before = codegen.__dict__.get("create_library")
    codegen.create_library = create
    try:
        yield
    finally:
        if before is None:
            del codegen.create_library
        else:
            codegen.create_library = before


class _Lowering(typed_passes.BaseNativeLowering):
    """Chooses the library by who calls the function."""

    def run_pass(self, state: Any) -> bool:
        if state.library is None:
            codegen = state.targetctx.codegen()
            is_linked = state.flags.no_cpython_wrapper and state.func_id.func not in OWN_CODE
            kind = HelperLibrary if is_linked else RootLibrary
            state.library = kind(codegen, state.func_id.func_qualname)
            state.library.enable_object_caching()
        with _loops_as_helpers(state.targetctx.codegen()):
            return bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class SerialLowering(_Lowering):
    """Of functions without parallel loops."""

    _name = "torchrender_lowering"

    @property
    def lowering_class(self) -> Any:
        return typed_passes.NativeLowering().lowering_class


@register_pass(mutates_CFG=True, analysis_only=False)
class ParallelLowering(_Lowering):
    """Of functions with parallel loops."""

    _name = "torchrender_parallel_lowering"

    @property
    def lowering_class(self) -> Any:
        return ParforLower


class KernelCompiler(compiler.CompilerBase):
    """Numba's own way, with the lowering above."""

    def define_pipelines(self) -> list[Any]:
        """One, without object mode, and without the source text with the type of every variable."""
        manager = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        ours = {typed_passes.NativeLowering: SerialLowering, typed_passes.NativeParforLowering: ParallelLowering}
        kept = [(one, told) for one, told in manager.passes if one is not typed_passes.AnnotateTypes]
        manager.passes = [(ours.get(one, one), told) for one, told in kept]
        self.state.type_annotation = ""
        manager._finalized = False
        manager.finalize()
        return [manager]


_jit = templates._OverloadFunctionTemplate._get_jit_decorator


def _overload_as_helper(self: Any) -> Any:
    """Decorator of numba's own functions, ``np.zeros`` and the like: in kernels they are helpers.

    Kernels, and what is compiled for them, have no wrapper for C, which tells them from others' functions; numba keeps
    what it compiles by such flags, so that neither gets what was made for the other.
    """
    decorator, flags = _jit(self), ConfigStack.top_or_none()
    if flags is None or not flags.no_cfunc_wrapper:
        return decorator
    return partial(decorator, pipeline_class=KernelCompiler, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def link_overloads() -> None:
    """Numba's own functions only linked, too; again does nothing more."""
    templates._OverloadFunctionTemplate._get_jit_decorator = _overload_as_helper


def rebuild(target: Any, payload: tuple[Any, ...]) -> Any:
    """What ``CompileResult._reduce`` made, of a helper or of a function that Python calls."""
    (name, kind, code), description, environment, signature, _, lifted, annotation, reload_init, environments = payload
    if kind != KIND:
        return compiler.CompileResult._rebuild(target, *payload)
    for again in reload_init:
        again()
    library = HelperLibrary.restored(target.codegen(), name, code)
    return compiler.compile_result(
        target_context=target,
        typing_context=target.typing_context,
        library=library,
        environment=environment,
        entry_point=target.get_executable(library, description, environment),
        fndesc=description,
        type_annotation=annotation,
        signature=signature,
        objectmode=False,
        lifted=lifted,
        reload_init=reload_init,
        referenced_envs=list(environments),
    )
