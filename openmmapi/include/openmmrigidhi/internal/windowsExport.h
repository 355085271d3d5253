#ifndef OPENMMRIGIDHI_WINDOWS_EXPORT_H_
#define OPENMMRIGIDHI_WINDOWS_EXPORT_H_

// Libraries are built with hidden visibility; this marks what they export.
#define OPENMM_EXPORT_RIGIDHI __attribute__((visibility("default")))

#endif
