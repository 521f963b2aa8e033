/* The files of the page, made at build time from page/. */
#ifndef DIO_WEB_PAGE_H
#define DIO_WEB_PAGE_H

#include <stddef.h>
#include <stdint.h>

extern const uint8_t dio_page_index_html[], dio_page_page_css[], dio_page_page_js[];
extern const size_t dio_page_index_html_size, dio_page_page_css_size, dio_page_page_js_size;

#endif
