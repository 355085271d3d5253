"""Copying, pickling and recognising SWIG's classes.

OpenMM returns their objects as objects of more general classes.
"""
import copy

import openmm


def _unpickle(cls, xml, attributes):
    return cls._adopt(openmm.XmlSerializer.deserialize(xml), attributes)


class Copies:
    """A class over a SWIG class `_base`, which OpenMM returns as the more general `_generic`."""
    @classmethod
    def _cast_generic(cls, obj):
        return obj if isinstance(obj, cls) else cls._adopt(obj)

    @classmethod
    def _adopt(cls, obj, attributes=None):
        """Wrap the C++ object of a generic object in this class, and move its ownership."""
        earlier = getattr(obj, '_rigidHIWrapper', None)
        if earlier is not None:
            return earlier
        found = cls._base._fromGeneric(obj) if isinstance(obj, cls._generic) else None
        if found is None:
            raise TypeError(
                f'{cls.__name__}.cast: obj: got {type(obj).__name__}; it must be a {cls.__name__}, '
                f'or an openmm.{cls._generic.__name__} that is one')
        result = cls.__new__(cls)
        result.this = found.this
        result.thisown = obj.thisown
        if obj.thisown:
            # obj must not outlive what it points to.
            obj.thisown = False
            obj._rigidHIWrapper = result
        else:
            # Whoever owns the C++ object lives as long as obj does.
            result._rigidHISource = obj
        for name, value in (attributes or {}).items():
            setattr(result, name, value)
        return result

    def _python_attributes(self):
        hidden = ('this', '_rigidHISource')
        return {name: value for name, value in self.__dict__.items() if name not in hidden}

    def __copy__(self):
        """A new object with the same settings, bound to no Context."""
        return type(self)._adopt(openmm.XmlSerializer.clone(self), self._python_attributes())

    def __deepcopy__(self, memo):
        """A new object with the same settings, bound to no Context."""
        return type(self)._adopt(openmm.XmlSerializer.clone(self),
                                 copy.deepcopy(self._python_attributes(), memo))

    def __reduce__(self):
        return _unpickle, (type(self), openmm.XmlSerializer.serialize(self),
                           self._python_attributes())
