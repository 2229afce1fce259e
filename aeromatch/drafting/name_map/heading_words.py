"""Words of the headings of recorders: quantities, senses, sides, and headings of other subjects.

All words are in lower case without separators.
"""

from __future__ import annotations

# Names of channels in recorders, in lower case without separators. The symbols of the field are
# known to `flightmech.errors.find_symbol`.
_ENGLISH = {
    "p": "p ratep rollrate bodyrollrate gyrox gyrp wx",
    "q": "q rateq pitchrate bodypitchrate gyroy gyrq wy",
    "r": "r rater yawrate bodyyawrate gyroz gyrr wz",
    "phi": "bank roll euler1 attroll rollatt rollattitude bankatt bankattitude",
    "theta": "pitch attpitch pitchatt pitchattitude",
    "psi": "hdgtrue trueheading headingtrue truehdg hdgt headingt trueyaw yaw heading hdg",
    "ax_imu": (
        "ax nx fx accx xacc accelx axb axbody longacc longaccel longitudinalacc longitudinalaccel "
        "longitudinalacceleration forwardacceleration"
    ),
    "ay_imu": (
        "ay ny fy accy yacc accely ayb aybody latacc lataccel lateralacc lateralaccel "
        "lateralacceleration"
    ),
    "az_imu": (
        "az nz fz accz zacc accelz azb azbody normacc normaccel normalacc normalaccel vertacc "
        "vertaccel normalacceleration verticalacceleration loadfactor normalloadfactor gload"
    ),
    "alpha_vane": "alpha aoa alfa alphavane aoavane vanealpha angleofattack incidence",
    "beta_vane": (
        "beta aos betavane aosvane vanebeta sideslip sideslipvane vanesideslip sideslipangle "
        "angleofsideslip ssa"
    ),
    "V": "tas ktas vtas vtrue trueairspeed v airspeedtrue",
    "V_cas": "cas ias vcas vias kcas kias calibratedairspeed indicatedairspeed vc vi airspeed",
    "mach": "mach machnumber ma",
    "q_c": (
        "qc impactpress impactpressure pitotpressure diffpressure differentialpressure "
        "dynamicpressure"
    ),
    "qbar": "qbar",
    "p_static": "ps pstat staticpress staticpressure pstatic baropressure ambientpressure",
    "temperature": (
        "oat sat temperature outsideairtemperature outsidetemperature statictemperature "
        "airtemperature temp"
    ),
    "h_baro": (
        "h hp alt altitude height pressurealtitude pressalt baroaltitude baroalt altbaro palt "
        "hbaro altpress altstd stdalt baroaltstd altbarostd altitudestd standardaltitude altqne "
        "qnealt alt1013 altitude1013 alt101325 altitude101325 altitude101325mb"
    ),
    "V_ground": "groundspeed gspd gndspd gndspeed groundspd gpsspeed gpsgroundspeed",
    "h_gps": "hgps altgps gpsalt gpsaltitude gpsheight altitudegps gnssaltitude gnssheight",
    "h_radio": (
        "hradio radioaltitude radioalt radalt ralt radaralt radaraltitude radioheight raltitude"
    ),
    "vn": (
        "vn vnorth velnorth gsn gpsveln northvel velocitynorth northvelocity gpsvn veln vgn "
        "northspeed gsnorth groundspeednorth nsvelocity nsvel velocityns velns"
    ),
    "ve": (
        "ve veast veleast gse gpsvele eastvel velocityeast eastvelocity gpsve vele vge "
        "eastspeed gseast groundspeedeast ewvelocity ewvel velocityew velew"
    ),
    "vd": "vd vdown veldown gpsveld downvel velocitydown downvelocity gpsvd veld vgd downspeed",
    "hdot": (
        "hdot climbrate rateofclimb roc vsi verticalspeed verticalvelocity vertspeed vertspd "
        "inertialverticalspeed inertialvertspeed ivv baroverticalspeed vs vspeed vvi"
    ),
    "lat": "lat latitude gpslat gpslatitude",
    "lon": "lon long longitude gpslon gpslongitude",
    "delta_e": "elevator elev elv de ele deltae dele",
    "delta_a": "aileron ail da deltaa dail",
    "delta_r": "rudder rud dr deltar drud",
    "delta_f": "flap flaps df deltaf flapangle",
    "delta_t": "trimtab elevatortab elevatortrim elevtrim pitchtrim elevatortrimtab",
    "gear": "gear landinggear ldggear undercarriage gearextension geardown",
    "speedbrake": "speedbrake spdbrk spdbrake airbrake speedbrakes airbrakes",
    "column": (
        "column controlcolumn ccp controlcol ctrlcol ctrlcolumn pitchstick sticklong stickpitch "
        "columntravel"
    ),
    "wheel": "wheel controlwheel cwp ctrlwheel rollstick sticklat stickroll",
    "pedal": "pedal pedals rudderpedal rudderpedals",
    "F_column": (
        "fcolumn colforce ctrlcolforce controlcolumnforce stickforce elevatorforce columnforce "
        "stickforcepitch pitchforce stickforcelong"
    ),
    "F_wheel": "fwheel wheelforce ctrlwheelforce controlwheelforce stickforceroll rollforce",
    "F_pedal": "fpedal pedalforce rudderforce",
    "mass": "mass grossmass weight grossweight grosswt gw wt auw allupweight",
    "x_cg_b": "xcg",
    "y_cg_b": "ycg",
    "z_cg_b": "zcg",
    "engine.throttle": "throttle powerlever thr thrustlever throttlelever",
    "engine.pla": "pla powerleverangle tla thrustleverangle throttleleverangle",
    "engine.n1": "n1 fanspeed",
    "engine.n2": "n2",
    "engine.fuel_flow": "fuelflow ff wf",
    "engine.thrust": "thrust netthrust fn enginethrust",
    "engine.itt": "itt",
    "engine.torque": "torque trq tq",
    "engine.epr": "epr enginepressureratio",
    "engine.manifold_pressure": "map manifoldpressure manifoldpress manpress",
    "engine.rpm": "rpm proprpm propellerrpm propellerspeed np",
    "engine.prop_command": "proplever propellerlever",
    "engine.cutoff": "fuelcut fuelcutoff cutoff",
}
# German headings, as the recorders of gliders and light aircraft have them; an umlaut is two
# letters. "Kurs" is left out: it is a track or a heading.
_GERMAN = {
    "q": "nickrate",
    "r": "gierrate",
    "phi": "rollwinkel haengewinkel querlage querneigung",
    "theta": "nickwinkel laengsneigung",
    "psi": "steuerkurs gierwinkel azimut",
    "ax_imu": "laengsbeschleunigung",
    "ay_imu": "querbeschleunigung",
    "az_imu": "normalbeschleunigung lastvielfaches",
    "alpha_vane": "anstellwinkel",
    "beta_vane": "schiebewinkel",
    "V": "eigengeschwindigkeit",
    "V_cas": "fahrt",
    "q_c": "staudruck",
    "p_static": "statischerdruck statikdruck",
    "temperature": "aussentemp aussentemperatur lufttemperatur",
    "h_baro": "druckhoehe",
    "h_gps": "gpshoehe",
    "V_ground": "geschwindigkeituebergrund",
    "vn": "vnord geschwindigkeitnord nordgeschwindigkeit",
    "ve": "vost geschwindigkeitost ostgeschwindigkeit",
    "hdot": "steigen steigrate steiggeschwindigkeit vario variometer",
    "delta_e": "hoehenruder",
    "delta_a": "querruder",
    "delta_r": "seitenruder",
    "delta_f": "klappe klappen landeklappe landeklappen woelbklappe",
    "mass": "masse flugmasse abflugmasse",
    "engine.throttle": "gashebel leistungshebel",
    "engine.fuel_flow": "kraftstofffluss kraftstoffdurchfluss",
    "engine.thrust": "schub",
    "engine.torque": "drehmoment",
}
HEADING_WORDS = {
    name: f"{words} {_GERMAN.get(name, '')}".strip() for name, words in _ENGLISH.items()
}
# Quantity of each name of a channel.
NAME_QUANTITY: dict[str, str] = {}
for _quantity, _names in HEADING_WORDS.items():
    NAME_QUANTITY |= dict.fromkeys(_names.split(), _quantity)
# Recorded quantity of each canonical name that is a corrected quantity.
RECORDED = {
    "x_cg": "x_cg_b",
    "alpha": "alpha_vane",
    "beta": "beta_vane",
    "h": "h_baro",
    "ax": "ax_imu",
    "ay": "ay_imu",
    "az": "az_imu",
}
# Words of a heading that do not name a quantity.
_DECORATION_TEXT = (
    "pos posn position defl deflection angle ang meas measured sensor raw value act actual "
    "filtered filt corr corrected body rec surf surface lever adc ins ahrs imu ads fms efis irs "
    "dau daq fdr egi nav air adhrs boom"
)
DECORATION = frozenset(_DECORATION_TEXT.split())
# Sign of a heading with a word for a direction: +1 if it is the positive direction of the quantity,
# -1 if it is the opposite one. Positive are trailing edge down, trailing edge left, and an aileron
# deflection that rolls to the left.
_TRAILING_EDGE = {"teu": -1, "ted": 1}
_NOSE_UP = {"anu": 1, "nu": 1, "and": -1, "nd": -1}
_RIGHT_WING_DOWN = {"rwd": 1, "lwd": -1}
_NOSE_RIGHT = {"anr": 1, "nr": 1, "anl": -1, "nl": -1}
SENSES = {
    "delta_e": {"teu": -1, "ted": 1, "anu": -1, "nu": -1, "and": 1, "nd": 1, "up": -1, "dn": 1},
    "delta_a": {"lwd": 1, "rwd": -1, "lrd": 1, "rrd": -1, "teu": -1, "ted": 1},
    "delta_a_left": _TRAILING_EDGE,
    "delta_a_right": _TRAILING_EDGE,
    "delta_f": _TRAILING_EDGE,
    "delta_t": _TRAILING_EDGE,
    "delta_r": {"tel": 1, "ter": -1, "anl": 1, "nl": 1, "anr": -1, "nr": -1},
    "theta": _NOSE_UP,
    "q": _NOSE_UP,
    "alpha_vane": _NOSE_UP,
    "phi": _RIGHT_WING_DOWN,
    "p": _RIGHT_WING_DOWN,
    "psi": _NOSE_RIGHT,
    "r": _NOSE_RIGHT,
}
# Senses whose meaning one recorder alone shows, and what else they may mean.
_RRD = "taken as the aileron that rolls {}, may be the {} aileron trailing edge down: {}"
DOUBTFUL_SENSES = {
    "rrd": _RRD.format("right", "right", "the other sign"),
    "lrd": _RRD.format("left", "left", "the other sign"),
}
# Number of an engine or of a surface by the word for its side.
SIDES = {
    "l": 1,
    "lh": 1,
    "left": 1,
    "links": 1,
    "port": 1,
    "r": 2,
    "rh": 2,
    "right": 2,
    "rechts": 2,
    "stbd": 2,
}
SENSE_WORDS = frozenset().union(*SENSES.values())

# Known headings of other subjects, in the form of the names above, and the reason why no channel is
# drafted from them.
_OTHER_SUBJECTS = {
    "a magnetic heading; psi is the true heading: add it by hand with the variation as offset": (
        "maghdg maghead magheading hdgm hdgmag headingm headingmag magneticheading mh compass"
    ),
    "a track over the ground, no heading": "trk track trackangle trktrue tracktrue cog course",
    "a total temperature; temperature is the static one": "tat totaltemp totaltemperature rat",
    "a total pressure; q_c is total less static pressure": "pt ptot totalpress totalpressure pitot",
    "an engine or rotor speed, which no model uses": "enginerpm engrpm erpm nr",
    "a speed of the gas generator; n1 or n2, by the engine": "ng gasgenerator",
    "a temperature of the engine that no model uses": (
        "egt cht tit t5 t45 mgt oiltemp oiltemperature"
    ),
    "an oil pressure": "oilpress oilpressure",
    "a quantity of fuel; mass is the gross mass": (
        "fuelqty fuelquantity fuel fuelused fuelremaining fob"
    ),
    "a lever that no model uses": "conditionlever mixture mixturelever",
    "a stabilizer or trim position; delta_t is the elevator tab, i_h the stabilizer: add it by "
    "hand": ("hstab stab stabtrim stabilizer stabiliser stabilizertrim htrim hstabtrim"),
    "a trim position of another surface": "ailtrim ailerontrim rudtrim ruddertrim rolltrim yawtrim",
    "a ground speed or a glide slope: which one is not stated": "gs",
    "a relative humidity or a radio height: which one is not stated": "rh",
    "a lever; delta_f is the surface": "flaplever flaphandle flapselector",
    "slats, which no model has": "slat slats",
    "a spoiler; delta_s, delta_sp and speedbrake differ: add it by hand": "spoiler spoilers splr",
}
OTHER_SUBJECT: dict[str, str] = {}
"""Reason why no channel is drafted, by the name of a channel."""
for _reason, _names in _OTHER_SUBJECTS.items():
    OTHER_SUBJECT |= dict.fromkeys(_names.split(), _reason)
# Words that make another quantity of the words behind them.
_QUALIFIER_TEXT = (
    "mag magnetic vert vertical ground gnd wind total trim tab cmd command commanded demand "
    "demanded target ref reference selected sel bug set setpoint error err dev deviation std sigma "
    "cabin fuel oil cog fail failed valid status flag limit max min inertial cross hyd hydraulic "
    "bus battery"
)
QUALIFIERS = frozenset(_QUALIFIER_TEXT.split())
"""Words that make another quantity of the words behind them: a MAG heading, a CABIN altitude."""
