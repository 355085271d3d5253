#ifndef OPENMMRIGIDHI_WINDOWS_EXPORT_H_
#define OPENMMRIGIDHI_WINDOWS_EXPORT_H_

// Libraries have hidden visibility; this macro marks the symbols that they export.
#define OPENMM_EXPORT_RIGIDHI __attribute__((visibility("default")))

#endif
