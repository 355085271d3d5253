"""Names of a package that are imported at their first use.

A process then imports only what it uses. Workers of an ensemble start twice as fast.
"""
import importlib
import importlib.util
import sys


def lazy(package, places):
    """The functions __getattr__ and __dir__ of a package.

    Parameters
    ----------
    package : str
        the package's name
    places : dict
        name of each module of the package -> the names that the package takes from it

    Returns
    -------
    getattr, dir : callables
    """
    modules = {name: module for module, names in places.items() for name in names}

    def get_attribute(name):
        module = modules.get(name, name)
        if name not in modules and (name.startswith('__')
                                    or importlib.util.find_spec(f'{package}.{name}') is None):
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        value = importlib.import_module(f'{package}.{module}')
        if name in modules:
            value = getattr(value, name)
        setattr(sys.modules[package], name, value)
        return value

    def names():
        return sorted({*vars(sys.modules[package]), *modules})

    return get_attribute, names
