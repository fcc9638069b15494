"""Drive simulated instruments with drivers that others wrote; runs in an environment of its own.

Usage: python drive.py NAME ADDRESS. Prints what the driver found, as JSON.
"""

import asyncio
import json
import sys
from collections.abc import Callable
from tempfile import NamedTemporaryFile, gettempdir
from typing import Any

Found = dict[str, Any]


async def magritek_spinsolve(address: str) -> Found:
    from fastapi import BackgroundTasks
    from flowchem.devices.magritek.spinsolve import Spinsolve

    host, _, port = address.rpartition(":")
    # The schema that it would check answers with is installed with the maker's software.
    nmr = Spinsolve(host=host, port=int(port), name="nmr", xml_schema=False, data_folder="run")
    await nmr.initialize()
    await nmr.set_solvent("D2O")
    await nmr.set_sample("sample 1")
    await nmr.set_user_data({"batch": "7"})
    tasks = BackgroundTasks()
    number = await nmr.run_protocol("1d proton", tasks, {"Scan": "QuickScan"})
    await asyncio.wait_for(tasks(), 60)
    # It takes the state Ready for the end, and the files come with Completed.
    await asyncio.sleep(1)
    long = BackgroundTasks()
    second = await nmr.run_protocol("1D EXTENDED+", long, {"Number": 4})
    await nmr.abort()
    await asyncio.wait_for(long(), 60)
    return {
        "version": nmr.device_info.version,
        "protocols": nmr.list_protocols(),
        "solvent": await nmr.get_solvent(),
        "sample": await nmr.get_sample(),
        "user_data": await nmr.get_user_data(),
        "numbers": [number, second],
        "folder": await nmr.get_result_folder(0),
    }


async def hamilton_ml600(port: str) -> Found:
    from flowchem import ureg
    from flowchem.devices.hamilton.ml600 import ML600, HamiltonPumpIO

    io = HamiltonPumpIO.from_config({"port": port})
    await io.initialize()
    pump = ML600(io, syringe_volume="5 ml", name="pump")
    await io.all_hw_init()
    await asyncio.sleep(0.3)
    await pump.wait_until_idle()
    version = await pump.version()
    await pump.set_to_volume(ureg("2 ml"), ureg("60 ml/min"))
    await pump.wait_until_idle()
    volume = await pump.get_current_volume()
    await pump.set_valve_position_by_name(target_position="2", wait_for_movement_end=False)
    await pump.wait_until_idle()
    await pump.set_to_volume(ureg("0 ml"), ureg("60 ml/min"))
    await pump.wait_until_idle()
    return {
        "pumps": io.num_pump_connected,
        "version": version,
        "volume_ml": volume.m_as("ml"),
        "angle": await pump.get_valve_angle(),
    }


async def harvard_elite_11(port: str) -> Found:
    from flowchem.devices.harvardapparatus.elite11 import Elite11

    pump = Elite11.from_config(port, "14.567 mm", "10 ml", address=0, name="pump")
    await pump.initialize()
    await pump.set_withdrawing_flow_rate("30 ml/min")
    await pump.set_target_volume("3 ml")
    await pump.withdraw()
    rate = await pump.get_current_flow_rate()
    await pump.wait_until_idle()
    return {"version": await pump.version(), "rate_ml_min": rate}


async def huber_pb(port: str) -> Found:
    from flowchem import ureg
    from flowchem.devices.huber.chiller import HuberChiller

    chiller = HuberChiller.from_config(port, name="chiller")
    await chiller.initialize()
    await chiller.set_temperature(ureg.Quantity("45.5 °C"))
    return {
        "serial": chiller.device_info.serial_number,
        "setpoint_c": await chiller.get_temperature_setpoint(),
        "limits_c": list(await chiller.temperature_limits()),
    }


async def heidolph_hei_connect(port: str) -> Found:
    from flowchem import ureg
    from flowchem.devices.heidolph.hei_connect import HeiConnect

    plate = HeiConnect.from_config(port, name="plate", connection_check=False)
    await plate.initialize()
    await plate.set_speed(ureg("500 rpm"))
    await plate.start_stirring()
    await plate.set_heating_mode("fast")
    await asyncio.sleep(0.3)
    return {
        "speed_rpm": await plate.get_speed(),
        "status": await plate.status(),
        "mode": await plate.get_heating_mode(),
    }


async def vacuubrand_cvc3000(port: str) -> Found:
    from flowchem import ureg
    from flowchem.devices.vacuubrand.cvc3000 import CVC3000

    vacuum = CVC3000.from_config(port, name="vacuum")
    await vacuum.initialize()
    await vacuum.set_pressure(ureg("300 mbar"))
    status = await vacuum.status()
    return {"pressure_mbar": await vacuum.get_pressure(), "control": int(status.control)}


async def runze_sy01(port: str) -> Found:
    from flowchem import ureg
    from flowchem.devices.runze.runze_syringe_pump import RunzeSyringePump

    pump = RunzeSyringePump.from_config(port=port, address=0, name="p", syringe_volume="5 mL")
    await pump.home()
    await pump.set_raw_position("1")
    await pump.set_to_volume(ureg("2 mL"))
    volume = await pump.get_current_volume()
    await pump.set_raw_position("3")
    await pump.set_to_volume(ureg("0 mL"))
    refused = await pump.set_raw_position("9", raise_errors=False)
    return {"volume_ml": volume.m_as("ml"), "refused": not refused}


async def knauer_azura_compact(address: str) -> Found:
    from flowchem import ureg
    from flowchem.devices.knauer.azura_compact import AzuraCompact

    host, _, port = address.partition(":")
    pump = AzuraCompact(ip_address=host, name="pump")
    pump.TCP_PORT = int(port)
    await pump.initialize()
    await pump.set_flow_rate(ureg("6 ml/min"))
    await pump.infuse()
    await asyncio.sleep(1.0)
    pressure = await pump.read_pressure()
    await pump.stop()
    return {
        "flow_ml_min": await pump.get_flow_rate(),
        "pressure_bar": pressure.m_as("bar"),
        "errors": await pump.read_errors(),
    }


async def knauer_valve(address: str) -> Found:
    from flowchem.devices.knauer.knauer_valve import KnauerValve

    host, _, port = address.partition(":")
    valve = KnauerValve(ip_address=host, name="valve")
    valve.TCP_PORT = int(port)
    await valve.initialize()
    await valve.set_raw_position("4")
    await asyncio.sleep(0.3)
    return {
        "type": str(valve.device_info.additional_info["valve-type"].value),
        "position": await valve.get_raw_position(),
    }


async def cytomat(port: str) -> Found:
    from pylabrobot.storage.cytomat import CytomatBackend

    store = CytomatBackend("C6000", port)
    await store.setup()
    before = await store.get_overview_register()
    after = await store.send_action("mv", "ts", "007", timeout=60)
    temperature = await store.get_temperature()
    await store.stop()
    return {
        "before": before.transfer_station_occupied,
        "after": after.transfer_station_occupied,
        "temperature_c": temperature,
    }


async def bioshake(port: str) -> Found:
    from pylabrobot.heating_shaking.bioshake_backend import BioShake

    shaker = BioShake(port=port, timeout=2)
    await shaker.setup(skip_home=True)
    await shaker.start_shaking(600, 1)
    await shaker.stop_shaking()
    await shaker.unlock_plate()
    temperature = await shaker.get_current_temperature()
    await shaker.stop()
    return {"temperature_c": temperature}


async def spectramax(port: str) -> Found:
    from pylabrobot.plate_reading.molecular_devices import (
        KineticSettings,
        MolecularDevicesError,
        MolecularDevicesSpectraMax384PlusBackend,
        MolecularDevicesSpectraMaxM5Backend,
        ReadType,
    )
    from pylabrobot.resources import Cor_96_wellplate_360ul_Fb

    reader = MolecularDevicesSpectraMax384PlusBackend(port)
    plate = Cor_96_wellplate_360ul_Fb("plate")
    await reader.setup()
    await reader.open()
    refused = ""
    try:
        await reader.read_absorbance(plate, [450])
    except MolecularDevicesError as error:
        refused = str(error)
    await reader.close()
    await reader.set_temperature(30)
    target_c = (await reader.get_temperature())[1]
    reads = await reader.read_absorbance(plate, [450, 700])
    kinetic = KineticSettings(interval=20, num_readings=2)
    again = await reader.read_absorbance(
        plate, [450], read_type=ReadType.KINETIC, kinetic_settings=kinetic
    )
    await reader.stop()
    # That of the M5 asks for the same reading by other words.
    other = MolecularDevicesSpectraMaxM5Backend(port)
    await other.setup()
    by_other = await other.read_absorbance(plate, [450])
    await other.stop()
    return {
        "by_other": by_other[0]["data"][0][0],
        "refused": refused,
        "target_c": target_c,
        "wavelengths": [read["wavelength"] for read in reads],
        "size": [len(reads[0]["data"]), len(reads[0]["data"][0])],
        "a1": [read["data"][0][0] for read in reads],
        "h12": reads[0]["data"][7][11],
        "kinetic": len(again),
    }


def neware_bts(address: str) -> Found:
    from aurora_neware import NewareAPI

    host, _, port = address.partition(":")
    with NewareAPI(host, int(port)) as cycler:
        with NamedTemporaryFile(suffix=".xml") as program:
            started = cycler.start("21-1-1", "cell-1", program.name, gettempdir())
        status = cycler.inquire("21-1-1")["21-1-1"]
        steps = cycler.get_steps("21-1-1")
        stopped = cycler.stop("21-1-1")
        return {
            "channels": len(cycler.channel_map),
            "start": started[0]["start"],
            "status": status["workstatus"],
            "barcode": status["barcode"],
            "first_step": steps[0]["steptype"],
            "stop": stopped[0]["stop"],
        }


def new_era_ne1000(port: str) -> Found:
    from nesp_lib import Port, Pump, PumpingDirection

    with Port(port, 19200) as line:
        pump = Pump(line)
        pump.syringe_diameter_mm = 14.57
        pump.pumping_direction = PumpingDirection.WITHDRAW
        pump.pumping_volume_ml = 2.0
        pump.pumping_rate_ml_per_min = 6.0
        pump.run()
        return {"model": pump.model_number, "withdrawn_ml": pump.volume_withdrawn_ml}


def tdk_genesys(port: str) -> Found:
    from pymeasure.instruments.tdk import TDK_Gen40_38

    supply = TDK_Gen40_38(f"ASRL{port}::INSTR", visa_library="@py", baud_rate=9600)
    supply.remote = "REM"
    supply.voltage_setpoint = 1.82
    supply.current_setpoint = 1.5
    supply.output_enabled = True
    return {
        "id": supply.id,
        "volt": supply.voltage,
        "ampere": supply.current,
        "mode": supply.mode,
    }


def tti_pl(address: str) -> Found:
    from pymeasure.instruments.aimtti import PL155P

    host, _, port = address.partition(":")
    supply = PL155P(
        f"TCPIP::{host}::{port}::SOCKET",
        visa_library="@py",
        read_termination="\r\n",
        write_termination="\n",
    )
    channel = supply.ch_1
    channel.voltage_setpoint = 1.82
    channel.current_limit = 1.5
    channel.output_enabled = True
    return {"volt": channel.voltage, "ampere": channel.current, "id": supply.id}


DRIVERS: dict[str, Callable[[str], Any]] = {
    driver.__name__: driver
    for driver in (
        *(hamilton_ml600, harvard_elite_11, huber_pb, heidolph_hei_connect, vacuubrand_cvc3000),
        *(runze_sy01, knauer_azura_compact, knauer_valve, cytomat, bioshake, spectramax),
        *(neware_bts, new_era_ne1000, tdk_genesys, tti_pl, magritek_spinsolve),
    )
}


def main() -> int:
    driver = DRIVERS[sys.argv[1]]
    outcome = driver(sys.argv[2])
    found = asyncio.run(outcome) if asyncio.iscoroutine(outcome) else outcome
    sys.stdout.write("FOUND " + json.dumps(found) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
