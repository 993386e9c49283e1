/* Preprocessed only: does this C library have strlcpy? libzmq defines its own where there is none. */
#include <string.h>
#if defined(__GLIBC__) && __GLIBC_PREREQ(2, 38)
HAS_STRLCPY
#endif
