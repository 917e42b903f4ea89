# Humid air as a mixture of ideal gases.
#
# Source: O. A. Alduchov and R. E. Eskridge, J. Appl. Meteorol. 35 (1996) 601 (saturation over water); ASHRAE Handbook,
# Fundamentals (2017), chapter 1 (humidity ratio, enthalpy, volume).
# Range: -40 degC to 50 degC near atmospheric pressure; over water below 0 degC too. At saturation the humidity
# ratio lies some 0.7 % and the enthalpy 0.5 % below those of the real gas.
#
# `T` is a temperature in degC, `p` the total pressure; `w` is the humidity ratio, mass of water per mass of dry air. Enthalpy and
# volume are per mass of dry air; the enthalpy of dry air and liquid water is zero at 0 degC.

def air_saturation(T) = 610.94 [Pa]*exp(17.625*value(T, degC)/(value(T, degC) + 243.04))
def air_humidity(p_w, p) = 0.621945*((p_w/(p - p_w)) as [1])
def air_vapour_pressure(w, p) = p*w/(0.621945 + w)
def air_saturated_humidity(T, p) = air_humidity(air_saturation(T), p)
def air_relative_humidity(T, w, p) = air_vapour_pressure(w, p)/air_saturation(T)
def air_dew_point(w, p) = {
  let log_p = ln(air_vapour_pressure(w, p)/(610.94 [Pa]))
  celsius((243.04*log_p/(17.625 - log_p) + 273.15) as [K])
}
def air_enthalpy(T, w) = (1.006*value(T, degC) + w*(2501 + 1.86*value(T, degC))) as [kJ/kg]
def air_volume(T, w, p) = 287.042 [J/(kg K)]*kelvin(T)*(1 + 1.607858*w)/p

# Humidity ratio that psychrometry finds from the temperature and that of a wet bulb, above 0 degC.
def air_wet_bulb_humidity(T, T_wet, p) = ((2501 - 2.326*value(T_wet, degC))*air_saturated_humidity(T_wet, p)
                                          - 1.006*(value(T, degC) - value(T_wet, degC)))/(2501 + 1.86*value(T, degC) - 4.186*value(T_wet, degC))
