"""The names of gsd's modes and frames, which version 3 of gsd changed."""
import gsd
import gsd.hoomd
import gsd.version

_version = getattr(gsd, '__version__', None) or gsd.version.version
READ, UPDATE, WRITE = ('r', 'r+', 'w') if int(_version.split('.')[0]) >= 3 else ('rb', 'rb+', 'wb')
Frame = getattr(gsd.hoomd, 'Frame', None) or gsd.hoomd.Snapshot
