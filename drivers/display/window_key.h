/* SDL's keys as Linux numbers them. */
#ifndef DIO_DISPLAY_WINDOW_KEY_H
#define DIO_DISPLAY_WINDOW_KEY_H

#include <SDL.h>
#include <stdint.h>

/** A code of linux/input-event-codes.h; 0: none of ours. */
uint32_t dio_window_key(SDL_Scancode scancode);

#endif
