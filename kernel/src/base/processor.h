/* What the processor can do, looked up once. */
#ifndef AEROMATCH_PROCESSOR_H
#define AEROMATCH_PROCESSOR_H

/* Lanes of doubles that the processor and an operating system that keeps its registers allow: four
 * with AVX2, eight with AVX-512, otherwise one. */
int lanes_here(void);

#endif
