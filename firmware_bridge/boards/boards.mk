# The images of the boards: make boards. Each needs arm-none-eabi-gcc (Debian: gcc-arm-none-eabi,
# libnewlib-arm-none-eabi). HSE_HZ is the crystal of the STM32F405 board.

CROSS ?= arm-none-eabi-
HSE_HZ ?= 8000000
BUILD ?= build
BOARDS_BUILD := $(BUILD)/boards

BOARD_FLAGS := -mcpu=cortex-m4 -mthumb -mfloat-abi=soft
BOARD_CFLAGS := $(BOARD_FLAGS) -std=c11 -Os -g -ffreestanding -fno-common \
  -ffunction-sections -fdata-sections -fstack-usage -fcallgraph-info=su \
  -Wall -Wextra -Wconversion -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wundef -Wvla -Werror \
  -I. -Iboards/stm32f405 -DHSE_HZ=$(HSE_HZ)U
BOARD_LDFLAGS := $(BOARD_FLAGS) -nostartfiles --specs=nano.specs -Wl,--gc-sections \
  -Wl,--fatal-warnings -Wl,-T,boards/stm32f405/stm32f405.ld

BOARD_CORE := $(sort $(wildcard protocol/*.c core/*.c))
BOARD_SHARED := $(addprefix boards/stm32f405/,startup.c program.c timing.c usart.c port_serial.c)
BOARD_CHIP := $(addprefix boards/stm32f405/,board.c adc.c clocks.c pins.c watchdog.c)
BOARD_IMAGES := stm32f405 stm32f405_can qemu

stm32f405_SOURCES := $(BOARD_CORE) $(BOARD_SHARED) $(BOARD_CHIP)
stm32f405_can_SOURCES := $(subst port_serial.c,port_can.c,$(stm32f405_SOURCES))
qemu_SOURCES := $(BOARD_CORE) $(BOARD_SHARED) boards/qemu/board.c boards/qemu/feed.c \
  boards/stm32f405/pins.c

board_objects = $(patsubst %.c,$(BOARDS_BUILD)/%.o,$($(1)_SOURCES))

.PHONY: boards
boards: $(foreach image,$(BOARD_IMAGES),$(BOARDS_BUILD)/$(image).elf $(BOARDS_BUILD)/$(image).bin) \
  $(BOARDS_BUILD)/stm32f405_in_qemu.elf $(BOARDS_BUILD)/stm32f405_can_in_qemu.elf
	$(CROSS)size $(filter %.elf,$^)

$(BOARDS_BUILD)/%.o: %.c boards/boards.mk
	@mkdir -p $(@D)
	$(CROSS)gcc $(BOARD_CFLAGS) -MMD -MP -c $< -o $@

comma := ,
define board_image
$(BOARDS_BUILD)/$(1).elf: $(call board_objects,$(1)) boards/stm32f405/stm32f405.ld
	$(CROSS)gcc $(BOARD_LDFLAGS) -Wl,-Map,$$(@:.elf=.map) $$(filter %.o,$$^) -o $$@
$(BOARDS_BUILD)/$(1)_in_qemu.elf: $(call board_objects,$(1)) boards/stm32f405/stm32f405.ld
	$(CROSS)gcc $$(BOARD_LDFLAGS) $$(filter %.o,$$^) -o $$@
endef
$(foreach image,$(BOARD_IMAGES),$(eval $(call board_image,$(image))))

# The images of the chip for QEMU: what it lacks is RAM there, where tests can look at it.
IN_RAM := chip_number=0x20010000 rcc_block=0x20011000 flash_block=0x20011400 \
  gpioa_block=0x20012000 gpiob_block=0x20012400 gpioc_block=0x20012800 adc1_block=0x20013000 \
  adc_ccr_block=0x20013304 dma2_block=0x20014000 iwdg_block=0x20015000 can1_block=0x20016000
$(BOARDS_BUILD)/%_in_qemu.elf: BOARD_LDFLAGS += $(addprefix -Wl$(comma)--defsym$(comma),$(IN_RAM))

$(BOARDS_BUILD)/%.bin: $(BOARDS_BUILD)/%.elf
	$(CROSS)objcopy -O binary $< $@

-include $(patsubst %.o,%.d,$(sort $(foreach image,$(BOARD_IMAGES),$(call board_objects,$(image)))))
