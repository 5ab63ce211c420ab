/* What a compiled library says about itself. */
#include "core.h"

/* Number of the interface between C and Python, `INTERFACE` of library.py: raise both where a function or a table changes. */
API int mbdae_interface(void) { return 17; }

/* Digest of the sources and flags it was compiled from (build.py); its text is also found in the file, without opening it. */
API const char *mbdae_sources(void) { return MBDAE_SOURCES; }
