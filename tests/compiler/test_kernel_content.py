"""The name of a compiled kernel: it changes with all that the code depends on, and with nothing else."""

import dis
import functools
import itertools
import random
import sys
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

import kernel_changes as shipped
import numpy as np
from numba import from_dtype, types

from palpate.compiler import code_cache
from palpate.compiler.content import bytecode, closure
from palpate.compiler.kernel import CompiledKernel, kernel, replacement
from palpate.compiler.target import target
from palpate.nodes.base.compiled import CompiledNode, record

CHANGES = 200
HERE = target.PINNED.target_context.codegen()
OTHERS = 30  # Kernels, drawn at random, that a change does not concern


def digest(kernel):
    return closure.digest([kernel], replacement)[0]


@functools.cache
def before():
    return {name: digest(kernel) for name, kernel in shipped.kernels().items()}


def changed(names):
    return {name for name in names if digest(shipped.kernels()[name]) != before()[name]}


def a_constant(kernel, draw):
    """Another number in the code of a kernel or of a function that it depends on."""
    function = draw.choice([each for each in (kernel.py_func, *map(shipped.function_of, shipped.used(kernel.py_func)))
                            if each is not None and each.__module__.startswith("palpate")])  # fmt: skip
    code = shipped.changed_constant(function, draw)
    return code and (shipped.put(function, "__code__", code), function)


def a_global(kernel, draw):
    """Another value of a global name that the kernel reads."""
    function = kernel.py_func
    names = shipped.global_names(function)
    found = {name: shipped.other(function.__globals__.get(name)) for name in sorted(names)}
    found = {name: value for name, value in found.items() if value is not None}
    if not found:
        return None
    name = draw.choice([*found])
    return shipped.put(function.__globals__, name, found[name]), (function.__globals__, name)


def a_callee(kernel, draw):
    """Another kernel under the name of one that the kernel calls."""
    function = kernel.py_func
    names = shipped.global_names(function)
    found = [name for name in sorted(names) if isinstance(function.__globals__.get(name), CompiledKernel)]
    if not found:
        return None
    name = draw.choice(found)
    others = [each for each in shipped.kernels().values() if each is not function.__globals__[name].made]
    return shipped.put(function.__globals__, name, draw.choice(others)), (function.__globals__, name)


def a_variable(kernel, draw):
    """Another value of a variable of the function around a kernel or an intrinsic: layouts, laws, flags."""
    functions = [kernel.py_func, *(shipped.function_of(each) for each in shipped.used(kernel.py_func))]
    cells = [(cell, function) for function in functions if function is not None and function.__closure__
             for cell in function.__closure__ if shipped.other(cell.cell_contents) is not None]  # fmt: skip
    if not cells:
        return None
    cell, function = draw.choice(cells)
    return shipped.put(cell, "cell_contents", shipped.other(cell.cell_contents)), function


def a_layout(kernel, draw):
    """Another type of a field of a NamedTuple that the kernel makes of a record."""
    found = [each for each in shipped.used(kernel.py_func) if shipped.unpacked(each)]
    if not found:
        return None
    kind = draw.choice(shipped.unpacked(draw.choice(found)))
    field = draw.choice(kind._fields)
    other = int if kind.__annotations__[field] is float else float
    return shipped.put(kind.__annotations__, field, other), kind


def an_option(kernel, draw):
    name, value = draw.choice([("error_model", "other"), ("forceinline", "other"), ("nogil", "other"), ("inline", 1)])
    return shipped.put(kernel, "targetoptions", {**kernel.targetoptions, name: value}), kernel.py_func


def a_default(kernel, draw):
    return shipped.put(kernel.py_func, "__defaults__", (draw.random(),)), kernel.py_func


KINDS = [a_constant, a_global, a_callee, a_variable, a_layout, an_option, a_default]


def of_modules(function, name):
    """The global names of which a function reads this attribute."""
    lines = list(dis.get_instructions(function.__code__))
    return {
        one.argval
        for one, other in itertools.pairwise(lines)
        if one.opname == "LOAD_GLOBAL" and other.opname in ("LOAD_ATTR", "LOAD_METHOD") and other.argval == name
    }


def concerned(what):
    """The kernels that depend on a function or a NamedTuple, or that read a global name of a module."""
    if isinstance(what, type):
        unpacking = [each for each in shipped.intrinsics().values() if what in shipped.unpacked(each)]
        return set().union(*(shipped.callers()[id(shipped.function_of(each))] for each in unpacking))
    if not isinstance(what, tuple):
        return shipped.callers()[id(what)]
    namespace, name = what
    value, found = namespace[name], set()
    for function in {id(each.py_func): each.py_func for each in shipped.kernels().values()}.values():
        used = shipped.global_names(function)
        by_module = any(vars(function.__globals__[each]) is namespace for each in of_modules(function, name)
                        if isinstance(function.__globals__.get(each), ModuleType))  # fmt: skip
        if (function.__globals__ is namespace and name in used) or by_module:
            found |= shipped.callers()[id(function)]
    assert value is namespace[name]
    return found


def test_a_change_alters_the_names_of_the_kernel_and_its_callers_only():
    draw, names = random.Random(86), sorted(shipped.kernels())
    assert len(names) > 550 and not changed(names)
    for number in range(CHANGES):
        kind, made = KINDS[number % len(KINDS)], None
        while made is None:
            made = kind(shipped.kernels()[draw.choice(names)], draw)
        change, what = made
        expected = concerned(what)
        with change:
            found = changed(sorted(expected | set(draw.sample(names, OTHERS))))
        assert found == expected and expected, (number, kind.__name__, what)
    assert not changed(names)  # each change was taken back


def inner_codes(code):
    """All code objects inside one, in the order of the source, by their qualified names."""
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield each
            yield from inner_codes(each)


def test_docstrings_comments_lines_and_classes_around_kernels_alter_no_name():
    draw, count = random.Random(86), 0
    files = {kernel.py_func.__code__.co_filename for kernel in shipped.kernels().values()}
    of_kernels = {(k.py_func.__code__.co_filename, k.py_func.__code__.co_qualname) for k in shipped.kernels().values()}
    for file in sorted(files):
        text = Path(file).read_text(encoding="utf-8")
        same = compile(text, file, "exec"), compile(shipped.changes_of_text(text, draw), "elsewhere.py", "exec")
        old, new = ([each for each in inner_codes(code) if (file, each.co_qualname) in of_kernels] for code in same)
        assert [each.co_qualname for each in old] == [each.co_qualname for each in new]
        for one, other in zip(old, new, strict=True):
            assert bytecode.read_code(one) == bytecode.read_code(other), (file, one.co_qualname)
            count += one.co_firstlineno != other.co_firstlineno
    assert count > 400


def test_another_layout_of_a_record_alters_the_name():
    shipped.kernels()  # imports all nodes
    draw = random.Random(86)
    kinds = [each for each in CompiledNode.__subclasses__() if "compute" in vars(each) and record(each).fields]
    for kind in draw.sample(kinds, 10):
        layout = record(kind)
        fields = [(name, *layout.fields[name]) for name in layout.names]
        names, formats, offsets = ([field[k] for field in fields] for k in range(3))
        at = draw.randrange(len(names))
        forms = [
            layout,
            np.dtype({"names": [*names[:at], "other", *names[at + 1 :]], "formats": formats, "offsets": offsets}),
            np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": layout.itemsize + 8}),
            np.dtype({"names": names[::-1], "formats": formats[::-1], "offsets": [k + 8 for k in offsets[::-1]]}),
            np.dtype([(n, "<f4" if k == at else f) for k, (n, f) in enumerate(zip(names, formats, strict=True))]),
        ]
        made = {code_cache.Names(kind.compute, ((from_dtype(each), types.float64), None), HERE)._name for each in forms}
        assert len(made) == len(forms), kind


def test_every_name_in_bytecode_is_read_as_python_reads_it():
    """Functions of the standard library, against `dis`."""
    count = 0
    modules = [each for name, each in sorted(sys.modules.items()) if name.partition(".")[0] in sys.stdlib_module_names]
    for function in (each for module in modules for each in list(vars(module).values())):
        if isinstance(function, FunctionType):
            code = function.__code__
            expected = [one.argval for one in dis.get_instructions(code) if one.opcode in dis.hasname]
            read = [word[5:] for word in bytecode._Reader(code).words if word.startswith("name:")]
            assert read == expected, function
            count += len(read)
    assert count > 1000


def test_a_docstring_that_is_new_leaves_the_code():
    def plain(x):
        return None if x > 3.0 else np.float64(7) ** x

    def documented(x):
        """Text."""
        # comment

        return None if x > 3.0 else np.float64(7) ** x

    codes = [each.__code__.replace(co_name="f") for each in (plain, documented)]
    assert bytecode.read_code(codes[0]) == bytecode.read_code(codes[1])
    assert bytecode.read_code(codes[0]).paths == (("np", "float64"),) and bytecode.read_code(codes[0]).power


def test_kernels_that_call_each_other_have_names():
    namespace = {"kernel": kernel, "__name__": "cycle", "K": 1.0}
    exec("@kernel\ndef even(x):\n    return odd(x - K)\n@kernel\ndef odd(x):\n    return even(x - 1.0)\n", namespace)
    first = digest(namespace["even"]), digest(namespace["odd"])
    namespace["K"] = 2.0
    second = digest(namespace["even"]), digest(namespace["odd"])
    assert len({*first, *second}) == 4


def test_every_shipped_kernel_has_a_name_that_does_not_depend_on_the_process():
    for name, each in shipped.kernels().items():
        assert not code_cache.Names(each, ((types.float64,), None), HERE).reason, name
    things = [known.of for known in closure._KNOWN.values()]
    assert not [each for each in things if isinstance(each, ModuleType)]  # nothing is read as a whole file
